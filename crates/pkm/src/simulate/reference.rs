//! `--reference`: a drawn motion, an exercise of the foot on an ankle robot, or the reference columns of a recording played back.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use pkm_dyn::model::Model;
use pkm_record::ReadOptions;
use pkm_sim::ankle::ANKLES;
use pkm_sim::{Ankle, AnkleExercise, AnkleMotion, Playback, Reference, ReferenceOptions, Shape, Shaped, Trajectory, check_limits};

/// Length of a drawn motion `[s]`.
const DURATION_S: f64 = 20.0;

/// Names of the motions that are drawn, and the share of the travel they use unless told otherwise.
const DRAWN: [(&str, f64); 4] = [("fourier", 0.6), ("min-jerk", 0.6), ("chirp", 0.2), ("step", 0.05)];

/// Frequencies of a sweep unless told otherwise `[Hz]`.
const SWEEP_HZ: (f64, f64) = (0.1, 2.0);

/// What the motion is.
#[derive(Debug, clap::Args)]
pub(crate) struct MotionArgs {
    /// fourier, min-jerk, chirp, step; on an ankle robot (motobotte) gait, gait-polynomial, isokinetic; or a recording (.csv or .mcap)
    /// whose reference is played back.
    #[arg(long, value_name = "MOTION", default_value = "fourier", help_heading = "Motion")]
    reference: String,
    /// Share of the travel that a drawn motion may use, 0 to 1; less where loops or limits demand it
    /// [default: 0.6, chirp 0.2, step 0.05].
    #[arg(long, value_name = "SHARE", help_heading = "Motion")]
    amplitude: Option<f64>,
    /// Period of fourier, or time from one move or step to the next.
    #[arg(long, value_name = "S", default_value_t = 5.0, help_heading = "Motion")]
    period: f64,
    /// Frequencies of a chirp at its begin and end, LOW:HIGH in Hz [default: 0.1:2].
    #[arg(long, value_name = "HZ:HZ", value_parser = sweep, help_heading = "Motion")]
    sweep: Option<(f64, f64)>,
    /// Topic of the joint states of the recording played back, where an MCAP file has several.
    #[arg(long, value_name = "TOPIC", help_heading = "Motion")]
    topic: Option<String>,
}

fn sweep(text: &str) -> Result<(f64, f64), String> {
    let number = |x: &str| x.trim().parse::<f64>().ok();
    text.split_once(':').and_then(|(low, high)| Some((number(low)?, number(high)?))).ok_or_else(|| "must be LOW:HIGH in Hz".to_string())
}

impl MotionArgs {
    /// The recording to be played back, if it is one.
    pub(super) fn file(&self) -> Option<&Path> {
        let is_drawn = DRAWN.iter().any(|(name, _)| *name == self.reference);
        (!is_drawn && self.exercise().is_none()).then(|| Path::new(&self.reference))
    }

    /// The exercise of an ankle, if it is one.
    fn exercise(&self) -> Option<AnkleExercise> {
        AnkleExercise::ALL.into_iter().find(|exercise| exercise.name() == self.reference)
    }

    /// What the recording's metadata calls it.
    pub(super) fn name(&self) -> String {
        if self.file().is_some() { "playback".to_string() } else { self.reference.clone() }
    }

    /// The motion, within the limits of `model`, and its length `[s]`.
    ///
    /// # Errors
    /// Numbers out of range, a file that cannot be read, a motion that leaves the limits.
    pub(super) fn build(&self, model: &Model, duration: Option<f64>, seed: u64) -> anyhow::Result<(Box<dyn Trajectory>, f64)> {
        if let Some(exercise) = self.exercise() {
            return self.exercised(model, exercise, duration);
        }
        let Some((kind, usual)) = DRAWN.iter().find(|(name, _)| *name == self.reference) else {
            return self.play(model, duration);
        };
        let (duration_s, amplitude) = (duration.unwrap_or(DURATION_S), self.amplitude.unwrap_or(*usual));
        let (low_hz, high_hz) = self.sweep.unwrap_or(SWEEP_HZ);
        let period_s = self.period;
        let shape = match *kind {
            "min-jerk" => Shape::MinimumJerk { period_s },
            "step" => Shape::Step { period_s },
            "chirp" => Shape::Chirp { low_hz, high_hz },
            _ => {
                let drawn = Reference::draw(model, &ReferenceOptions { seed, period_s, amplitude });
                return Ok((Box::new(drawn.with_context(|| self.place())?), duration_s));
            }
        };
        let drawn = Shaped::draw(model, shape, duration_s, amplitude, seed).with_context(|| self.place())?;
        Ok((Box::new(drawn), duration_s))
    }

    fn place(&self) -> String {
        format!("--reference {}", self.reference)
    }

    /// The drive's motion for an exercise of the foot.
    fn exercised(&self, model: &Model, exercise: AnkleExercise, duration: Option<f64>) -> anyhow::Result<(Box<dyn Trajectory>, f64)> {
        let Some(ankle) = Ankle::of(&model.name) else {
            let known: Vec<&str> = ANKLES.iter().map(|ankle| ankle.robot).collect();
            bail!("{}: robot {:?} moves no ankle that is known (there are: {})", self.place(), model.name, known.join(", "));
        };
        let motion = AnkleMotion::try_new(model, ankle, exercise).with_context(|| self.place())?;
        let usual = if exercise.repeats() { DURATION_S } else { exercise.length_s() };
        let duration_s = duration.unwrap_or(usual);
        check_limits(model, &motion, duration_s).with_context(|| self.place())?;
        Ok((Box::new(motion), duration_s))
    }

    fn play(&self, model: &Model, duration: Option<f64>) -> anyhow::Result<(Box<dyn Trajectory>, f64)> {
        let path = PathBuf::from(&self.reference);
        if !path.exists() {
            let exercises = AnkleExercise::ALL.iter().map(|exercise| exercise.name());
            let known: Vec<&str> = DRAWN.iter().map(|(name, _)| *name).chain(exercises).collect();
            bail!("{}: no such file, and no motion of that name (there are: {})", self.place(), known.join(", "));
        }
        let file = path.display().to_string();
        let recording = pkm_record::read(&path, &ReadOptions { topic: self.topic.clone(), recover: false })?;
        let mut columns = Vec::new();
        for &j in &model.actuators {
            let name = format!("q_ref.{}", model.joints[j].name);
            let Some(column) = recording.signal(&name) else { bail!("{file}: no column {name:?} (needed to play it back)") };
            if let Some(i) = column.iter().position(|x| !x.is_finite()) {
                bail!("{file}: {name} is missing at t = {} s (a reference has no gaps)", recording.time[i]);
            }
            columns.push(column.to_vec());
        }
        let motion = Playback::try_new(&recording.time, columns).with_context(|| file.clone())?;
        let length = motion.duration_s();
        let duration_s = duration.unwrap_or(length);
        ensure!(duration_s <= length, "{file}: lasts {length} s (--duration {duration_s} s is longer)");
        check_limits(model, &motion, duration_s).with_context(|| file.clone())?;
        Ok((Box::new(motion), duration_s))
    }
}
