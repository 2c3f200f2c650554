//! What these recordings could not have shown: the smallest size of each effect that would have been named.

use pkm_dyn::effects::{Site, find};
use pkm_dyn::math;
use pkm_dyn::model::JointKind;

use crate::columns::Family;
use crate::contest::SHOWN;
use crate::design::ColumnId;
use crate::isolability::projected;
use crate::settings::Settings;
use crate::verdict::{Detectable, Invisible};
use crate::work::{Candidate, Variant, Work};

/// Standard deviations a coefficient must stand out by; the search's own threshold over all candidates is of this order.
const SIGMAS: f64 = 3.0;

/// Weighted squared error of one joint over the fitted rows.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Power {
    /// As it is.
    pub(crate) plain: f64,
    /// As independent rows would need to have it for a coefficient to scatter as much: neighbouring rows of filtered noise are alike.
    pub(crate) coloured: f64,
}

/// A parameter, and the coefficients of a shape's own columns per unit of it.
struct Probe {
    parameter: &'static str,
    direction: Vec<f64>,
}

/// One entry per effect, place and parameter, in the candidates' order, and those that no size would show. `power` is what the final model
/// leaves at each joint.
pub(crate) fn detectable(work: &Work, power: &[Power], settings: &Settings) -> (Vec<Detectable>, Vec<Invisible>) {
    let mut out = Vec::new();
    let mut unseen = Vec::new();
    for at in 0..work.candidates.len() {
        let c = &work.candidates[at];
        let mut sizes: Vec<(&'static str, f64)> = Vec::new();
        let mut is_asked = false;
        let least = |strength: Strength| size(work, c, strength, power, settings);
        for v in c.variants.iter().filter(|v| v.softness.is_none_or(|w| w == work.softness)) {
            for (parameter, strength) in strengths(work, at, v) {
                is_asked = true;
                let size = least(strength);
                match sizes.iter_mut().find(|(p, _)| *p == parameter) {
                    Some((_, best)) => *best = best.min(size),
                    None => sizes.push((parameter, size)),
                }
            }
        }
        sizes.retain(|(_, size)| size.is_finite());
        if sizes.is_empty() && is_asked {
            let why = "its columns are zero along these motions, or friction, offsets and inertias of the model imitate them wholly";
            unseen.push(Invisible { effect: c.effect_name().to_string(), place: vec![c.name.clone()], why: why.to_string() });
        }
        let as_parameter = |(name, size): (&'static str, f64)| c.effect.smallest(size).filter(|v| v.is_finite()).map(|v| (name, v));
        out.extend(sizes.into_iter().filter_map(as_parameter).map(|(parameter, value)| entry(work, c, parameter, value)));
    }
    (out, unseen)
}

/// What one unit of a parameter does.
#[derive(Debug, Clone, Copy)]
struct Strength {
    /// Squared length that the model cannot imitate on the fitted rows.
    beside: f64,
    /// The whole of it, as a share of the effort.
    whole: f64,
}

/// Smallest size that would have been named: above chance, worth it as a share of the error, and worth it as a share of the effort.
fn size(work: &Work, c: &Candidate, Strength { beside: strength, whole }: Strength, power: &[Power], settings: &Settings) -> f64 {
    if strength <= 0.0 || whole <= 0.0 {
        return f64::INFINITY;
    }
    let sum = |f: &dyn Fn(usize) -> f64| c.scope.iter().map(|&j| f(j)).sum::<f64>();
    let by_chance = SIGMAS * math::sqrt(sum(&|j| power[j].coloured) / sum(&|j| count(work, j)).max(1.0) / strength);
    let by_worth = math::sqrt(settings.floor * sum(&|j| power[j].plain) / strength);
    let by_tolerance = settings.tolerance / whole;
    by_chance.max(by_worth).max(by_tolerance)
}

fn entry(work: &Work, c: &Candidate, parameter: &'static str, value: f64) -> Detectable {
    let entry = c.effect.entry();
    let kind = match c.site {
        Site::Joint => work.robot.model.joints[c.place].kind,
        _ => JointKind::Prismatic,
    };
    let unit = entry.parameters.iter().find(|p| p.name == parameter).map_or("", |p| p.unit.text(kind));
    let shown = if unit == "1" { String::new() } else { format!(" {unit}") };
    // Of a stiffness it is the large ones that nobody sees.
    let is_inverse = c.effect.smallest(2.0).zip(c.effect.smallest(1.0)).is_some_and(|(twice, once)| twice < once);
    let side = if is_inverse { "more" } else { "less" };
    let says = format!("{} at {}: {side} than {}{shown} of {parameter} cannot be seen", c.effect_name(), c.name, two_digits(value));
    Detectable {
        effect: c.effect_name().to_string(),
        place: c.places(&work.robot.model),
        parameter: parameter.to_string(),
        value,
        unit: unit.to_string(),
        says,
    }
}

/// Two significant digits.
fn two_digits(x: f64) -> String {
    if x <= 0.0 || !x.is_finite() {
        return "0".to_string();
    }
    if !(1e-3..1e5).contains(&x) {
        return format!("{x:.1e}");
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and 4")]
    let decimals = (1.0 - math::log10(x).floor()).clamp(0.0, 4.0) as usize;
    format!("{x:.decimals$}")
}

/// Parameters of a shape with what one unit of each does.
fn strengths(work: &Work, candidate: usize, v: &Variant) -> Vec<(&'static str, Strength)> {
    let (base, prior) = ground(work, candidate, v);
    let own = &v.columns[..v.n_own];
    let left = projected(&work.gram, &base, &prior, own);
    let raw: Vec<f64> = own.iter().map(|&id| (0..work.design.n_joints).map(|j| work.gram.power(id, j)).sum()).collect();
    let of = |d: &[f64]| -> Strength {
        let coefficient = |id: ColumnId| own.iter().position(|&o| o == id).map_or(0.0, |i| d[i]);
        let felt = crate::worth::of_columns(work, &work.candidates[candidate], v, &coefficient);
        // Fits are solved in units of each column's own size.
        let d: Vec<f64> = d.iter().zip(own).map(|(d, &id)| if work.gram.scale[id] > 0.0 { d / work.gram.scale[id] } else { 0.0 }).collect();
        let strength: f64 = (0..d.len()).flat_map(|i| (0..d.len()).map(move |j| (i, j))).map(|(i, j)| d[i] * left[(i, j)] * d[j]).sum();
        let whole: f64 = d.iter().zip(&raw).map(|(d, raw)| d * d * raw).sum();
        Strength { beside: if strength > SHOWN * whole { strength } else { 0.0 }, whole: felt }
    };
    probes(work, &work.candidates[candidate], v).into_iter().map(|p| (p.parameter, of(&p.direction))).collect()
}

/// What the effect is judged with, as the search does it: friction and offsets free; inertias within their prior for structure, as given
/// for a change of what the model already has; whatever was found; and the shape's own companions.
fn ground(work: &Work, candidate: usize, v: &Variant) -> (Vec<ColumnId>, Vec<f64>) {
    let c = &work.candidates[candidate];
    let kappa = if matches!(c.effect.family(), Family::Structural | Family::Chain) { work.kappa } else { 0.0 };
    let (mut base, mut prior) = work.with_rigid(work.every_model_has(work.softness), kappa);
    let (picked, picked_prior) = work.picked(work.picks.iter().position(|p| p.candidate == candidate));
    let companions = v.columns[v.n_own..].iter().map(|&id| (id, 0.0));
    for (id, p) in picked.into_iter().zip(picked_prior).chain(companions) {
        if !base.contains(&id) {
            base.push(id);
            prior.push(p);
        }
    }
    // An ordinary parameter is looked for with the others free, itself excepted.
    let is_standard = c.effect.family() == Family::Standard;
    let is_other = |id: &ColumnId| !v.columns[..v.n_own].contains(id) || (!is_standard && work.every_model_has(work.softness).contains(id));
    base.into_iter().zip(prior).filter(|(id, _)| is_other(id)).unzip()
}

/// The sizes that are asked for.
fn probes(work: &Work, c: &Candidate, v: &Variant) -> Vec<Probe> {
    let unit = |i: usize| (0..v.n_own).map(|k| if k == i { 1.0 } else { 0.0 }).collect::<Vec<f64>>();
    let one = |parameter| vec![Probe { parameter, direction: unit(0) }];
    match (c.effect_name(), v.values.as_slice()) {
        ("payload", _) => loads(work, c, v),
        // All ten parameters scaled is the size of an error; each on its own has no one size.
        ("inertia_error", _) if v.n_own > 1 => Vec::new(),
        ("inertia_error", _) => {
            let mass = work.robot.model.links[c.place].parameters.mass;
            if mass > 0.0 { vec![Probe { parameter: "mass", direction: vec![1.0 / mass] }] } else { Vec::new() }
        }
        // The phase is not known: the one seen best counts.
        ("torque_ripple", _) => {
            let phase = |k: u32| core::f64::consts::PI * f64::from(k) / 16.0;
            (0..16).map(|k| Probe { parameter: "amplitude", direction: vec![math::cos(phase(k)), math::sin(phase(k))] }).collect()
        }
        ("gravity_tilt", _) => {
            ["roll", "pitch"].into_iter().enumerate().map(|(i, parameter)| Probe { parameter, direction: unit(i) }).collect()
        }
        ("friction_stribeck", _) => one("stiction"),
        // Of another power the drag has another unit.
        ("friction_quadratic", [exponent, ..]) if (*exponent - 2.0).abs() > 1e-9 => Vec::new(),
        // A joint that gives very little before it slides looks like plain dry friction: no smallest stiffness can be told.
        ("friction_presliding", _) => Vec::new(),
        // A spring that hardens is seen where a straight one is: the smallest size is that one's.
        ("spring", [_, _, _]) => Vec::new(),
        // The parabola: c2·q² in Chebyshev polynomials of (q − middle)/half, its constant and line being anyone's.
        ("cable_force", [middle, half]) if v.n_own == 3 => {
            let direction = vec![middle * middle + 0.5 * half * half, 2.0 * middle * half, 0.5 * half * half];
            vec![Probe { parameter: "c2", direction }]
        }
        ("cable_force", _) => Vec::new(),
        ("external_force", _) => {
            let components = ["fx", "fy", "fz", "mx", "my", "mz"].into_iter().take(v.n_own).enumerate();
            components.map(|(i, parameter)| Probe { parameter, direction: unit(i) }).collect()
        }
        ("friction_asymmetric", [kind, ..]) => one(if *kind > 0.5 { "coulomb_pos" } else { "viscous_pos" }),
        ("friction_passive", [kind, ..]) => one(if *kind < 0.5 { "coulomb" } else { "viscous" }),
        (other, _) => find(other).and_then(|e| e.parameters.first()).map_or_else(Vec::new, |p| one(p.name)),
    }
}

/// A point mass at the link's centre and one radius of gyration away from it: the place seen best counts, so that a smaller mass cannot be
/// seen anywhere on the link.
fn loads(work: &Work, c: &Candidate, v: &Variant) -> Vec<Probe> {
    if v.n_own != 4 {
        return Vec::new();
    }
    let (centre, central) = work.robot.model.links[c.place].parameters.centre_of_mass();
    let radius = math::sqrt((central.trace() / work.robot.model.links[c.place].parameters.mass.max(1e-9)).max(0.0));
    let mut out = vec![[centre.x, centre.y, centre.z]];
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut at = [centre.x, centre.y, centre.z];
            at[axis] += sign * radius;
            out.push(at);
        }
    }
    out.into_iter().map(|[x, y, z]| Probe { parameter: "mass", direction: vec![1.0, x, y, z] }).collect()
}

fn rows_of<'a>(work: &'a Work<'_>, joint: usize) -> impl Iterator<Item = (usize, usize)> + 'a {
    work.design.rows.iter().enumerate().flat_map(move |(s, r)| {
        (0..r.time.len()).filter(move |&i| r.fold[i].is_some() && r.valid[i] && r.moving[joint][i]).map(move |i| (s, i))
    })
}

/// Rows of a joint that are fitted.
pub(crate) fn count(work: &Work, joint: usize) -> f64 {
    rows_of(work, joint).count() as f64
}

/// What `left` holds at each joint: [joint][segment][row].
pub(crate) fn left_power(work: &Work, left: &[Vec<Vec<f64>>]) -> Vec<Power> {
    (0..work.design.n_joints)
        .map(|j| {
            let w = work.design.weight[j] * work.design.weight[j];
            let sum: f64 = rows_of(work, j).map(|(s, i)| left[j][s][i] * left[j][s][i]).sum();
            let next: f64 = rows_of(work, j).filter(|(_, i)| *i > 0).map(|(s, i)| left[j][s][i] * left[j][s][i - 1]).sum();
            // Variance inflation of a mean of first-order autoregressive noise.
            let r = if sum > 0.0 { (next / sum).clamp(0.0, 0.95) } else { 0.0 };
            // Rows of surplus drives share the noise of their freedoms.
            let shared = if j < work.design.n_drives { work.design.drives_per_freedom() } else { 1.0 };
            Power { plain: w * sum, coloured: shared * w * sum * (1.0 + r) / (1.0 - r) }
        })
        .collect()
}
