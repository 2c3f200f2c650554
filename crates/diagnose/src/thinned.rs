//! Long recordings at the rate that their band needs.
//!
//! Efforts are compared below the band. A recording at 1 kHz in a band of 5 Hz is two hundred samples per period: beyond some minutes all that
//! these cost is time and memory. Taken is then every few samples of what positions and efforts are below ten times less than the new rate, so
//! nothing folds back. In the band that low-pass leaves all but three parts in a million, and averages noise as it did. What is lost is
//! where between two of these samples a direction changes, and there every fit leaves the rows of that joint out ([`crate::rows`]).

use pkm_ident::filter::LowPass;

use crate::segment::{Segment, every};
use crate::settings::{LONG, RATE};

/// Brings the segments of a diagnosis that are long altogether to the rate that their band needs; says so, one line per recording.
pub(crate) fn thin(segments: Vec<Segment>) -> (Vec<Segment>, Vec<String>) {
    if segments.iter().map(|s| s.valid.len()).sum::<usize>() <= LONG {
        return (segments, Vec::new());
    }
    let mut notes = Vec::new();
    let thinned = segments.into_iter().map(|s| {
        let every = every(s.dt, RATE * s.band);
        if every < 2 {
            return s;
        }
        notes.push(format!(
            "{}: {} samples are many for a band of {:.3} Hz: taken at {:.1} Hz instead of {:.1} Hz, behind a low-pass of {:.1} Hz",
            s.name,
            s.valid.len(),
            s.band,
            1.0 / (s.dt * every as f64),
            1.0 / s.dt,
            SMOOTH * s.band
        ));
        of(s, every)
    });
    (thinned.collect(), notes)
}

/// Positions of a segment are below this many bands already ([`crate::segment`]).
const SMOOTH: f64 = 5.0;

/// Every so many samples of a segment; what was not smoothed yet is, just as positions were.
fn of(s: Segment, every: usize) -> Segment {
    let filter = LowPass::new(SMOOTH * s.band, s.dt);
    let pick = |x: &[f64]| -> Vec<f64> { x.iter().step_by(every).copied().collect() };
    let picked = |all: &[Vec<f64>]| -> Vec<Vec<f64>> { all.iter().map(|x| pick(x)).collect() };
    let smooth = |x: &[f64]| pick(&filter.apply(x));
    let mut wrenches = s.wrenches;
    wrenches.iter_mut().flat_map(|w| &mut w.components).for_each(|x| *x = smooth(x));
    Segment {
        dt: s.dt * every as f64,
        q: picked(&s.q),
        v: picked(&s.v),
        a: picked(&s.a),
        tau: s.tau.iter().map(|x| smooth(x)).collect(),
        warmth: picked(&s.warmth),
        extra: s.extra.iter().map(|(name, x)| (name.clone(), pick(x))).collect(),
        // A sample that was missing is in its neighbours by now.
        valid: s.valid.chunks(every).map(|part| part.iter().all(|ok| *ok)).collect(),
        channels: s.channels.iter().map(|(kind, x)| (*kind, x.as_ref().map(|x| smooth(x)))).collect(),
        wrenches,
        ..s
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::TAU;

    use pkm_dyn::math;

    use super::*;
    use crate::testing::Bench;

    fn sine(s: &Segment, hz: f64) -> Vec<f64> {
        (0..s.valid.len()).map(|i| math::sin(TAU * hz * s.dt * i as f64)).collect()
    }

    /// A segment at 500 Hz in a band of 2 Hz: to be taken at 100 Hz.
    fn segment() -> Segment {
        Segment { band: 2.0, ..Bench::pair().motion.segment }
    }

    #[test]
    fn what_is_in_the_band_stays_and_what_would_fold_into_it_is_gone() {
        let mut s = segment();
        // The second folds to 1 Hz.
        s.tau = vec![sine(&s, 1.0), sine(&s, 99.0)];
        let t = of(s.clone(), every(s.dt, RATE * s.band));
        assert!((t.dt - 0.01).abs() < 1e-15 && t.valid.len() == s.valid.len() / 5, "{} s, {}", t.dt, t.valid.len());
        let within = 100..t.valid.len() - 100;
        for i in within {
            let time = t.dt * i as f64;
            assert!((t.tau[0][i] - math::sin(TAU * time)).abs() < 3e-6, "{} at {time} s", t.tau[0][i]);
            assert!(t.tau[1][i].abs() < 1e-6, "{} at {time} s", t.tau[1][i]);
            assert!((t.q[0][i] - s.q[0][5 * i]).abs() <= 0.0);
        }
    }

    #[test]
    fn a_sample_that_is_missing_takes_the_one_made_of_it_along() {
        let mut s = segment();
        s.valid[1007] = false;
        let t = of(s.clone(), every(s.dt, RATE * s.band));
        let gone: Vec<usize> = (0..t.valid.len()).filter(|&i| !t.valid[i]).collect();
        assert_eq!(gone, [201]);
    }

    #[test]
    fn nothing_is_thinned_up_to_ten_minutes() {
        let s = segment();
        let n = LONG / s.valid.len();
        let (same, notes) = thin(vec![s.clone(); n]);
        assert!(notes.is_empty() && same.iter().all(|x| x.valid.len() == s.valid.len()));
        let (fewer, notes) = thin(vec![s.clone(); n + 1]);
        assert!(notes.len() == n + 1 && fewer.iter().all(|x| x.valid.len() == s.valid.len() / 5), "{:?}", notes.first());
    }
}
