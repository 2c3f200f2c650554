//! How each effect is looked for in recordings: regressor columns, shapes to try, physical vetoes, and the reading of a fit back into
//! the effect's own parameters. One file per effect, named as in the catalogue.

mod active_limb;
mod actuator_lag;
mod backlash;
mod cable_force;
mod contact;
mod controller_mismatch;
mod dead_zone;
mod directional_efficiency;
mod encoder_eccentricity;
mod encoder_offset;
pub(crate) mod external_force;
mod friction_asymmetric;
mod friction_coulomb;
mod friction_load;
mod friction_passive;
mod friction_position;
mod friction_presliding;
mod friction_quadratic;
mod friction_stribeck;
mod friction_thermal;
mod friction_viscous;
mod geometry_error;
mod gravity_tilt;
pub(crate) mod inertia_error;
mod joint_elasticity;
mod limb_impedance;
mod payload;
mod rotor_inertia;
mod saturation;
mod sensor_drift;
mod spring;
mod structure_flexibility;
mod time_delay;
mod torque_constant;
mod torque_offset;
mod torque_ripple;
mod transmission_coupling;

use pkm_dyn::Model;
use pkm_dyn::effects::{Entry, Site};

use crate::design::{Chain, ColumnId, Make};
use crate::explain::number;
use crate::held::{Held, Spot};
use crate::motion::Motion;
use crate::turning::Turn;

/// Every effect's columns.
pub(crate) const ALL: &[&dyn Columns] = &[
    &friction_coulomb::Effect,
    &friction_viscous::Effect,
    &torque_offset::Effect,
    &friction_stribeck::Effect,
    &friction_asymmetric::Effect,
    &friction_load::Effect,
    &friction_passive::Effect,
    &friction_quadratic::Effect,
    &payload::Effect,
    &inertia_error::Effect,
    &torque_constant::Effect,
    &rotor_inertia::Effect,
    &spring::Effect,
    &gravity_tilt::Effect,
    &encoder_offset::Effect,
    &torque_ripple::Effect,
    &time_delay::Effect,
    &actuator_lag::Effect,
    &friction_position::Effect,
    &friction_thermal::Effect,
    &directional_efficiency::Effect,
    &friction_presliding::Effect,
    &backlash::Effect,
    &joint_elasticity::Effect,
    &cable_force::Effect,
    &transmission_coupling::Effect,
    &saturation::Effect,
    &dead_zone::Effect,
    &encoder_eccentricity::Effect,
    &geometry_error::Effect,
    &structure_flexibility::Effect,
    &limb_impedance::Effect,
    &contact::Effect,
    &external_force::Effect,
    &active_limb::Effect,
    &sensor_drift::Effect,
    &controller_mismatch::Effect,
];

/// Names of the effects that a diagnosis can find, in the catalogue's order: those of which there are columns here.
#[must_use]
pub fn looked_for() -> Vec<&'static str> {
    ALL.iter().map(|c| c.entry().name).collect()
}

/// What a candidate competes with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Family {
    /// A parameter every model has (friction, offset): free while structure is sought, a finding when it moved.
    Standard,
    /// Physics outside the span of the parameters a model has.
    Structural,
    /// Inside or nearly inside the span of the inertial parameters.
    Shift,
    /// The drive's chain; its column is made from the fitted model, anew in every step.
    Chain,
}

/// The variable a finding is drawn against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Axis {
    Velocity,
    Position,
    Acceleration,
    /// The nominal rigid effort.
    Load,
    /// The finding's own column.
    Column,
}

/// What columns are made from, besides the motions.
pub(crate) struct Context<'c> {
    pub(crate) model: &'c Model,
    /// How directions pass through zero: [softness][tree joint], widest over segments.
    pub(crate) widths: &'c [Vec<Turn>],
    /// Top speed of each drive over all segments.
    pub(crate) top_speed: &'c [f64],
    /// Travel of each drive over all segments.
    pub(crate) travel: &'c [f64],
    /// Lowest and highest position of each drive over all segments.
    pub(crate) range: &'c [[f64; 2]],
    /// The motions that columns will be made for.
    pub(crate) motions: &'c [Motion],
    /// Band in which efforts are compared `[Hz]`.
    pub(crate) band: f64,
    pub(crate) massive: &'c [usize],
}

impl Context<'_> {
    /// Rows of all drives, and of all other positions that are measured.
    pub(crate) fn everywhere(&self) -> Vec<usize> {
        (0..self.model.n_act() + self.motions.first().map_or(0, |m| m.channels.len())).collect()
    }
}

/// A column: new, or one that every model has.
pub(crate) enum Source {
    /// Raw series per joint it acts on.
    New(Make),
    /// The new column of that number, counted over the candidate's shapes: what several shapes have in common is one column.
    Again(usize),
    /// Parameter `k` of the massive link of that position.
    Rigid(usize, usize),
    /// Damping of a drive.
    Viscous(usize),
    /// Dry friction of a drive at a softness.
    Coulomb(usize, usize),
    /// Constant at a drive.
    Offset(usize),
}

/// One shape of a candidate.
pub(crate) struct Shape {
    /// Nonlinear values that make the shape.
    pub(crate) values: Vec<f64>,
    /// Softness of directions it belongs to; `None` fits all.
    pub(crate) softness: Option<usize>,
    /// Columns.
    pub(crate) sources: Vec<Source>,
    /// Prior standard deviation of each coefficient; infinite is free.
    pub(crate) prior: Vec<f64>,
    /// How many leading columns are the effect itself; the others are ordinary parameters it is sought together with.
    pub(crate) n_own: usize,
    /// What the law is where it can no longer be told from something simpler: where this shape fits best, the effect is not there.
    pub(crate) limit: Option<&'static str>,
}

/// A candidate before its columns are computed.
pub(crate) struct Proposal {
    /// Index of the place in the model.
    pub(crate) place: usize,
    /// What that index counts.
    pub(crate) site: Site,
    /// The second joint of a pair.
    pub(crate) other: Option<usize>,
    /// Its name; of a pair, the first joint's.
    pub(crate) name: String,
    /// Drives whose rows it acts on.
    pub(crate) scope: Vec<usize>,
    /// Shapes to choose from.
    pub(crate) shapes: Vec<Shape>,
}

impl Proposal {
    /// At a drive, acting on its own row only.
    pub(crate) fn at_drive(ctx: &Context, drive: usize, shapes: Vec<Shape>) -> Self {
        let place = ctx.model.actuators[drive];
        Self { place, site: Site::Joint, other: None, name: ctx.model.joints[place].name.clone(), scope: vec![drive], shapes }
    }

    /// On a link, acting on every drive.
    pub(crate) fn on_link(ctx: &Context, link: usize, shapes: Vec<Shape>) -> Self {
        let scope = (0..ctx.model.n_act()).collect();
        Self { place: link, site: Site::Link, other: None, name: ctx.model.links[link].name.clone(), scope, shapes }
    }

    /// At a drive, acting on the rows of all drives and channels.
    pub(crate) fn of_all(ctx: &Context, drive: usize, shapes: Vec<Shape>) -> Self {
        Self { scope: ctx.everywhere(), ..Self::at_drive(ctx, drive, shapes) }
    }
}

impl Shape {
    /// Free coefficients, one softness for all.
    pub(crate) fn free(sources: Vec<Source>) -> Self {
        Self { values: Vec::new(), softness: None, prior: vec![f64::INFINITY; sources.len()], n_own: sources.len(), sources, limit: None }
    }

    /// Together with the offsets of some drives: where the rigid effort hardly varies, a share of it and a constant are nearly the same
    /// column, and neither pays without the other.
    pub(crate) fn with_offsets(mut self, drives: impl Iterator<Item = usize>) -> Self {
        for k in drives {
            self.sources.push(Source::Offset(k));
            self.prior.push(f64::INFINITY);
        }
        self
    }

    pub(crate) fn at(mut self, softness: usize) -> Self {
        self.softness = Some(softness);
        self
    }

    pub(crate) fn with(mut self, values: Vec<f64>) -> Self {
        self.values = values;
        self
    }

    /// Marks the shape as the one in which the law is nothing but `simpler`.
    pub(crate) fn into_limit(mut self, simpler: &'static str) -> Self {
        self.limit = Some(simpler);
        self
    }
}

/// A fit as an effect's file sees it.
pub(crate) struct View<'v> {
    pub(crate) model: &'v Model,
    /// Coefficients of the candidate's own columns.
    pub(crate) own: &'v [f64],
    /// The shape's nonlinear values.
    pub(crate) shape: &'v [f64],
    /// Place index.
    pub(crate) place: usize,
    /// Friction of the same drive in the model so far: change of Coulomb and viscous friction found, on top of nominal.
    pub(crate) coulomb_change: f64,
    pub(crate) viscous_change: f64,
    /// Chain found so far at the drive.
    pub(crate) chain: Chain,
}

/// An effect's own parameters, or why the fit cannot be this effect.
pub(crate) type Reading = Result<Vec<(&'static str, f64)>, String>;

/// One effect's way of being found.
pub(crate) trait Columns: Sync {
    /// Catalogue entry.
    fn entry(&self) -> &'static Entry;
    /// Values of a shape of these that stands in the place of a fuller one that cannot be; a reading may then take what the motions do not show for
    /// what is likeliest.
    fn stand_in(&self, values: &[f64]) -> Vec<f64> {
        values.to_vec()
    }
    /// What it competes with.
    fn family(&self) -> Family;
    /// What it is drawn against.
    fn axis(&self) -> Axis;
    /// Where and in which shapes to look for it.
    fn propose(&self, ctx: &Context) -> Vec<Proposal>;
    /// Reads coefficients as parameters; `Err` is a physical veto.
    fn read(&self, view: &View) -> Reading;
    /// Whether the shape with these values is an error of the recorded effort: the robot is as it was, and its file has no place for it.
    fn is_of_the_effort_reading(&self, _shape: &[f64]) -> bool {
        false
    }
    /// Whether a fit of the robot's own numbers can imitate it: frictions, offsets and masses that such a fit changes.
    fn is_refittable(&self) -> bool {
        self.family() == Family::Standard
    }
    /// How long the shape with these values acts `[s]`; `None` acts all the time.
    fn lasts(&self, _shape: &[f64]) -> Option<f64> {
        None
    }
    /// The leading parameter that a first coefficient of this size stands for; `None` where sizes mean nothing.
    fn smallest(&self, size: f64) -> Option<f64> {
        Some(size)
    }
}

/// The catalogue entry of that name; the names here are the file names of `pkm_dyn::effects`.
pub(crate) fn entry(name: &str) -> &'static Entry {
    // Every effect file here names its twin; a missing twin is a mistake in this library and caught by its tests.
    pkm_dyn::effects::find(name).unwrap_or(pkm_dyn::effects::CATALOGUE[0])
}

/// A stiffness from its inverse, which is what a fit gives.
pub(crate) fn stiffness(compliance: f64) -> Reading {
    if compliance <= 0.0 {
        Err(format!("it would stiffen under load (compliance {})", number(compliance)))
    } else {
        Ok(vec![("stiffness", 1.0 / compliance)])
    }
}

/// A column acting on one drive only.
pub(crate) fn local(drive: usize, f: impl Fn(&Motion, usize) -> Vec<f64> + Send + Sync + 'static) -> Source {
    Source::New(Box::new(move |m| vec![(drive, f(m, drive))]))
}

/// A column acting on all drives, from [drive][sample] series.
pub(crate) fn global(f: impl Fn(&Motion) -> Vec<Vec<f64>> + Send + Sync + 'static) -> Source {
    Source::New(Box::new(move |m| f(m).into_iter().enumerate().collect()))
}

/// A column acting alike on two drives; `f` is given the motion, both drives and the sample.
pub(crate) fn pair(drives: [usize; 2], f: impl Fn(&Motion, [usize; 2], usize) -> f64 + Send + Sync + 'static) -> Source {
    Source::New(Box::new(move |m| {
        let series: Vec<f64> = (0..m.segment.valid.len()).map(|i| f(m, drives, i)).collect();
        vec![(drives[0], series.clone()), (drives[1], series)]
    }))
}

/// The effort of all drives under a wrench at a spot of a link; `f` gives its component `c` (force first) at a sample, for the components `axes`.
pub(crate) fn on_held(
    (link, spot): (usize, Spot),
    axes: core::ops::Range<usize>,
    f: impl Fn(&Held, usize, usize) -> f64 + Send + Sync + 'static,
) -> Source {
    global(move |m| {
        let (n, drives) = (m.segment.valid.len(), m.rigid.len());
        let Some(held) = Held::find(&m.held, link, spot) else { return vec![vec![0.0; n]; drives] };
        let wrench: Vec<Vec<f64>> = axes.clone().map(|c| (0..n).map(|i| f(held, c, i)).collect()).collect();
        (0..drives).map(|k| held.felt(&wrench, axes.clone(), k)).collect()
    })
}

/// Middle and half of the range that a drive covers.
pub(crate) fn stroke(ctx: &Context, drive: usize) -> [f64; 2] {
    let [low, high] = ctx.range[drive];
    [0.5 * (low + high), 0.5 * (high - low)]
}

/// Drives that cover a range at all.
pub(crate) fn that_travel<'c>(ctx: &'c Context) -> impl Iterator<Item = usize> + 'c {
    (0..ctx.model.n_act()).filter(|&k| ctx.travel[k] > 0.0)
}

/// Column ids of what every model has.
#[derive(Debug, Clone, Default)]
pub(crate) struct StandardIds {
    pub(crate) rigid: Vec<ColumnId>,
    pub(crate) viscous: Vec<ColumnId>,
    pub(crate) coulomb: Vec<Vec<ColumnId>>,
    pub(crate) offset: Vec<ColumnId>,
    /// What one law of turning over has beyond another, of drives whose reversals are fitted: theirs may lie between the laws.
    pub(crate) turning: Vec<ColumnId>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_are_looked_for_in_the_order_of_the_catalogue() {
        let here = looked_for();
        let catalogue = pkm_dyn::effects::CATALOGUE.iter().map(|e| e.name);
        assert_eq!(here, catalogue.filter(|n| here.contains(n)).collect::<Vec<_>>());
        assert_eq!(here.len(), ALL.len());
    }
}
