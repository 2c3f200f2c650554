//! Efforts in kN or mN·m, with their sign turned or in each other's columns, before anything is looked for: [`pkm_ident::thousands`] and
//! [`pkm_ident::mixed`] along the motions of a diagnosis.

use pkm_dyn::Model;
use pkm_dyn::effects::Robot;
use pkm_ident::filter::LowPass;
use pkm_ident::mixed::{Pair, mixed};
use pkm_ident::thousands::{Seen, other_units, seen};

use crate::motion::Motion;
use crate::segment::every;
use crate::sharing;

/// Reasons against recordings whose efforts are in other units, or not those of their drives: one per motion and unit, drive or pair.
pub(crate) fn reasons(robot: &Robot, motions: &[Motion]) -> Vec<String> {
    motions.iter().flat_map(|m| of_motion(&robot.model, m)).collect()
}

fn of_motion(model: &Model, motion: &Motion) -> Vec<String> {
    let series: Vec<[Vec<f64>; 2]> = sharing::efforts_that_move(motion).into_iter().map(|e| e.map(|x| sampled(motion, &x))).collect();
    let drives: Vec<Option<Seen>> = series
        .iter()
        .enumerate()
        .map(|(k, [effort, given])| {
            let s = &motion.segment;
            let direction = Motion::direction(&s.v[k], motion.turns[0][model.actuators[k]]);
            let own = [&vec![1.0; direction.len()], &s.v[k], &direction, &s.a[k]].map(|x| sampled(motion, x));
            seen(effort, given, &own)
        })
        .collect();
    let pairs: Vec<Pair<'_>> = series.iter().map(|[effort, model]| Pair { effort, model }).collect();
    let name = &motion.segment.name;
    let units = other_units(model, name, &drives).into_iter().map(|found| found.to_string());
    units.chain(mixed(model, name, &pairs).into_iter().map(|found| found.to_string())).collect()
}

/// A series behind the band's filter at samples that may be used, no more of them than the band needs.
fn sampled(motion: &Motion, x: &[f64]) -> Vec<f64> {
    let s = &motion.segment;
    let every = every(s.dt, 5.0 * s.band);
    let smooth = LowPass::new(s.band, s.dt).apply(x);
    smooth.into_iter().zip(&s.valid).step_by(every).filter_map(|(x, is_valid)| is_valid.then_some(x)).collect()
}
