//! What no repetition brings back: the scatter of what is left from period to period, and the force on a link that would make it.
//!
//! Physics of the robot answers the same motion in the same way. A leftover that differs from one period to the next, far beyond the noise
//! of the sensors and slowly, is somebody pushing.

use alloc::collections::BTreeMap;

use pkm_dyn::effects::{Applied, find};
use pkm_dyn::math;

use crate::evidence::{Evidence, Refined};
use crate::explain::number;
use crate::final_fit::{errors, white_power_where};
use crate::hands::{AS_WELL, chance_alone, places};
use crate::settings::Settings;
use crate::verdict::{Compensation, EffectAt, Estimate, Finding, LookAlike, Status, Verdict};
use crate::work::Work;

/// Periods a recording must hold before one can be compared with another.
const PERIODS: usize = 3;

/// Difference of a motion from itself one period later, as a share of its variance, below which it repeats.
const SAME_MOTION: f64 = 0.02;

/// Power of the scatter over that of white noise from which on it is no noise.
const ABOVE_NOISE: f64 = 4.0;

/// Share of what is left that must be scatter.
const MOSTLY: f64 = 0.5;

/// Scatter worth a word whatever it looks like, as a share of the effort: drives and their amplifiers scatter by one or two percent on their own.
/// Smaller scatter must be shown to come from one force ([`crate::one_hand`]).
const WORTH: f64 = 0.02;

type Left = [Vec<Vec<f64>>];

/// Efforts that do not repeat: [segment][joint][row], zero outside whole periods, and the power they hold.
pub(crate) struct Scatter {
    pub(crate) series: Vec<Vec<Vec<f64>>>,
    /// Rows that lie in whole periods.
    pub(crate) rows: Vec<Vec<usize>>,
    /// The same by instant of the period: [segment][instant][period].
    pub(crate) alike: Vec<Vec<Vec<usize>>>,
    /// Largest ratio of the scatter's power to noise over the joints.
    over_noise: f64,
    /// Scatter over everything that is left, both in units of each joint's effort.
    share: f64,
    /// Root mean square over joints of scatter over effort.
    size: f64,
    periods: usize,
}

/// Looks for a person in what the final model leaves where the joints move, for one that sticks is held by what it is pushed with; changes the verdict, the
/// ranks of its pictures and the refined robot where there is one.
pub(crate) fn look_for_a_person(work: &Work, left: &Left, told: (&mut Verdict, &mut Evidence, &mut Refined), settings: &Settings) {
    let (verdict, evidence, refined) = told;
    let Some(entry) = find("active_limb") else { return };
    let Some((scatter, chance)) = worth_a_word(work, left, settings) else { return };
    if settings.leaves_out(entry.name) {
        return say_without_its_name(verdict, &scatter);
    }
    let places = places(work, &scatter);
    let Some((link, rms, unexplained)) = places.first().copied() else { return };
    let name = |link: usize| work.robot.model.links[link].name.clone();
    let says = format!("On link {}, {}: about {} N rms. {}", name(link), entry.sentence, number(rms), how(&scatter, chance));
    let others = places[1..].iter().filter(|(_, _, left)| *left < unexplained + AS_WELL);
    let cannot_tell_from: Vec<EffectAt> = others
        .map(|(other, _, _)| EffectAt {
            effect: entry.name.to_string(),
            place: vec![name(*other)],
            separating_experiment: "measure the force with a sensor on either link".to_string(),
        })
        .collect();
    let sure = if work.motions.len() < 2 { 0.79 } else { 0.9 };
    let look_alikes = entry.look_alikes.iter().map(|l| LookAlike {
        effect: l.effect.to_string(),
        place: vec![name(link)],
        why_not: format!("it would be the same in each of the {} periods, or in one of them only", scatter.periods),
        separating_experiment: l.experiment.to_string(),
    });
    let spread = rms / math::sqrt(2.0 * scatter.periods as f64);
    let estimate = Estimate { value: rms, ci95: [(rms - 2.0 * spread).max(0.0), rms + 2.0 * spread], unit: "N".to_string() };
    let before = place_in_order(verdict, scatter.share);
    let now = before.checked_sub(1).map_or(verdict.heldout.rms_nominal, |i| verdict.findings[i].heldout_rms_after);
    let finding = Finding {
        rank: before + 1,
        effect: entry.name.to_string(),
        place: vec![name(link)],
        regime: vec!["all".to_string()],
        when: format!("differently in each of {} periods", scatter.periods),
        confidence: sure * math::sqrt(scatter.share) / (1 + cannot_tell_from.len()) as f64,
        p_value: chance.unwrap_or(1.0 / (settings.null_runs + 1) as f64),
        parameters: BTreeMap::from([("rms".to_string(), estimate)]),
        heldout_rms_before: now,
        heldout_rms_after: now,
        equation: format!("{}; rms = {} N", entry.equation, number(rms)),
        says: says.clone(),
        look_alikes: look_alikes.collect(),
        cannot_tell_from,
        compensation: Compensation { in_refined_model: false, says: entry.compensation.to_string() },
        experiments: Vec::new(),
        depends_on_prior: None,
    };
    verdict.status = Status::NotRepeatable;
    verdict.nothing_missing = false;
    verdict.unexplained = crate::verdict::Unexplained { share_of_residual: verdict.unexplained.share_of_residual, ..Default::default() };
    verdict.says = format!("Not repeatable: {says} No model of the robot can predict it.");
    verdict.findings[before..].iter_mut().for_each(|f| f.rank += 1);
    evidence.findings.iter_mut().filter(|p| p.rank > before).for_each(|p| p.rank += 1);
    verdict.findings.insert(before, finding);
    refined.effects.push(Applied::at(entry, link, vec![rms]));
}

/// What does not repeat where it is worth a word, with the chance that drives alone look so much like one force where that had to be asked.
fn worth_a_word(work: &Work, left: &Left, settings: &Settings) -> Option<(Scatter, Option<f64>)> {
    let scatter = scatter(work, left)?;
    tracing::debug!(scatter.over_noise, scatter.share, scatter.size, scatter.periods, "what does not repeat");
    if scatter.over_noise < ABOVE_NOISE || scatter.share < MOSTLY || scatter.size < settings.tolerance {
        return None;
    }
    // The two tests of any finding, in one.
    let level = settings.search_level * settings.confirm_level;
    let chance = (scatter.size < WORTH).then(|| chance_alone(work, &scatter, settings));
    tracing::debug!(chance, level, "chance that drives which scatter alone look so much like one force");
    chance.is_none_or(|p| p <= level).then_some((scatter, chance))
}

/// How it shows that somebody pushes.
fn how(scatter: &Scatter, chance: Option<f64>) -> String {
    let together = chance.map(|p| format!(" The drives differ together, as one force makes them: by chance with p = {}.", number(p)));
    format!(
        "Over {} periods of one motion {:.0} % of what is left differs from period to period ({:.1} % of the effort, {:.0} times the sensors' noise in power).{}",
        scatter.periods,
        100.0 * scatter.share,
        100.0 * scatter.size,
        scatter.over_noise,
        together.unwrap_or_default()
    )
}

/// Where a person who makes this share of what is left stands among findings in the order of what they explain. What the controller was told
/// comes first, whatever it explains.
fn place_in_order(verdict: &Verdict, share: f64) -> usize {
    let made = share * verdict.heldout.rms_final * verdict.heldout.rms_final;
    let explains = |f: &Finding| f.heldout_rms_before * f.heldout_rms_before - f.heldout_rms_after * f.heldout_rms_after;
    verdict.findings.iter().position(|f| f.effect != "controller_mismatch" && explains(f) < made).unwrap_or(verdict.findings.len())
}

/// What does not repeat, where the name of its cause is left out.
fn say_without_its_name(verdict: &mut Verdict, scatter: &Scatter) {
    let (share, periods) = (100.0 * scatter.share, scatter.periods);
    verdict.status = Status::NotRepeatable;
    verdict.nothing_missing = false;
    verdict.says =
        format!("Not repeatable: over {periods} periods of one motion {share:.0} % of what is left differs from period to period.");
}

/// Rows per period of a motion, and whole periods in it; `None` where it does not repeat often enough.
fn period(q: &[Vec<f64>]) -> Option<(usize, usize)> {
    let n = q.first()?.len();
    let moving: Vec<(&Vec<f64>, f64)> = q
        .iter()
        .map(|q| {
            let mean = q.iter().sum::<f64>() / n as f64;
            (q, q.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / n as f64)
        })
        .collect();
    let most = moving.iter().map(|m| m.1).fold(0.0, f64::max);
    // Mean over the joints that move of the squared difference over twice the variance.
    let difference = |lag: usize| {
        let each = moving.iter().filter(|(_, var)| *var > 1e-6 * most && *var > 0.0).map(|(q, var)| {
            let sum: f64 = q.iter().zip(&q[lag..]).map(|(a, b)| (a - b) * (a - b)).sum();
            sum / (2.0 * var * (n - lag) as f64)
        });
        let (count, sum) = each.fold((0_usize, 0.0), |(c, s), d| (c + 1, s + d));
        if count == 0 { f64::INFINITY } else { sum / count as f64 }
    };
    let differences: Vec<f64> = (0..=n / PERIODS).map(difference).collect();
    // Neighbouring rows are alike as well: a period begins to count once the motion has left its start.
    let away = differences.iter().position(|d| *d > 0.3 && d.is_finite())?;
    let least = differences[away..].iter().copied().fold(f64::INFINITY, f64::min);
    if least > SAME_MOTION {
        return None;
    }
    let near = |d: &f64| *d < (2.0 * least).max(0.1 * SAME_MOTION);
    let first = away + differences[away..].iter().position(near)?;
    // Down to the bottom of that valley.
    let bottom =
        (first..differences.len()).take_while(|&l| near(&differences[l])).min_by(|&a, &b| differences[a].total_cmp(&differences[b]))?;
    Some((bottom, n / bottom))
}

fn scatter(work: &Work, left: &Left) -> Option<Scatter> {
    let d = &work.design;
    let n = work.robot.model.n_act();
    let (mut series, mut used, mut alike) = (Vec::new(), Vec::new(), Vec::new());
    let (mut most_periods, mut sums) = (0, vec![[0.0_f64; 3]; n]);
    for (s, rows) in d.rows.iter().enumerate() {
        let len = rows.time.len();
        let q = (0..n)
            .map(|k| {
                (0..len)
                    .map(|i| work.motions[s].segment.q[k][d.fine[s].raw_index(i).min(work.motions[s].segment.valid.len() - 1)])
                    .collect()
            })
            .collect::<Vec<Vec<f64>>>();
        let mut out = vec![vec![0.0; len]; n];
        let (mut at, mut instants) = (Vec::new(), Vec::new());
        if let Some((period, periods)) = period(&q) {
            most_periods = most_periods.max(periods);
            for phase in 0..period {
                let same: Vec<usize> = (0..periods).map(|p| p * period + phase).filter(|&i| i < len && rows.valid[i]).collect();
                if same.len() < PERIODS {
                    continue;
                }
                let unbiased = math::sqrt(same.len() as f64 / (same.len() - 1) as f64);
                for (j, out) in out.iter_mut().enumerate().filter(|(j, _)| same.iter().all(|&i| rows.moving[*j][i])) {
                    let mean = same.iter().map(|&i| left[j][s][i]).sum::<f64>() / same.len() as f64;
                    for &i in &same {
                        out[i] = unbiased * (left[j][s][i] - mean);
                        sums[j][0] += out[i] * out[i];
                        sums[j][1] += left[j][s][i] * left[j][s][i];
                        sums[j][2] += 1.0;
                    }
                }
                at.extend(&same);
                instants.push(same);
            }
        }
        at.sort_unstable();
        series.push(out);
        used.push(at);
        alike.push(instants);
    }
    if most_periods < PERIODS {
        return None;
    }
    let efforts = errors(work, left);
    let (mut over_noise, mut power, mut all) = (0.0_f64, 0.0, 0.0);
    for (j, [scattered, total, count]) in sums.into_iter().enumerate().filter(|(_, s)| s[2] > 0.0) {
        let effort = efforts[j].effort * efforts[j].effort;
        let noise = white_power_where(&work.design.rows, &left[j], |rows, i| rows.valid[i] && rows.moving[j][i]);
        over_noise = over_noise.max(scattered / count / noise.max(f64::MIN_POSITIVE));
        if effort > 0.0 {
            power += scattered / count / effort;
            all += total / count / effort;
        }
    }
    let share = if all > 0.0 { (power / all).min(1.0) } else { 0.0 };
    Some(Scatter { series, rows: used, alike, over_noise, share, size: math::sqrt(power / n as f64), periods: most_periods })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_period_of_a_motion_is_found_and_a_motion_without_one_has_none() {
        let wave = |i: usize| {
            0.3 * math::sin(core::f64::consts::TAU * i as f64 / 40.0)
                + 0.2 * math::sin(2.0 * core::f64::consts::TAU * i as f64 / 40.0 + 0.4)
        };
        let q: Vec<f64> = (0..170).map(wave).collect();
        assert_eq!(period(&[q]), Some((40, 4)));
        let never: Vec<f64> = (0..170).map(|i| math::sin(1e-3 * (i * i) as f64)).collect();
        assert_eq!(period(&[never]), None);
        assert_eq!(period(&[vec![1.0; 50]]), None);
    }
}
