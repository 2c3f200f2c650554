//! The bench on which a diagnosis is done: design, candidates, what every model has, what has been picked so far.

use faer::Mat;
use pkm_dyn::Model;
use pkm_dyn::effects::{Robot, Site};
use pkm_dyn::parameters::N_INERTIAL;
use pkm_ident::filter::{advanced, derivative};

use crate::columns::{self, Columns, Context, Family, Shape, Source, StandardIds};
use crate::design::{ColumnId, Design, Fine, Make, View};
use crate::extents::{extents, ranges, widest_turns};
use crate::gram::{Gram, Targets};
use crate::motion::Motion;
use crate::screen;
use crate::settings::{SOFTNESS, Settings};
use crate::shelf::{Stored, Tape};
use crate::solve::Over;
use crate::turning::Turn;
use crate::window::{Place, Scan};

/// Positions are known this much better than efforts: what is worth a name there is smaller by this share.
const POSITION_WORTH: f64 = 0.1;

/// A shape with its columns in the design.
#[derive(Debug, Clone)]
pub(crate) struct Variant {
    pub(crate) values: Vec<f64>,
    pub(crate) softness: Option<usize>,
    pub(crate) columns: Vec<ColumnId>,
    /// Prior standard deviation per column; infinite is free.
    pub(crate) prior: Vec<f64>,
    /// How many leading columns are the effect itself.
    pub(crate) n_own: usize,
    /// What the law is in this shape, if it is something simpler.
    pub(crate) limit: Option<&'static str>,
}

/// An effect at a place, in the shapes it may take.
#[derive(Clone)]
pub(crate) struct Candidate {
    pub(crate) effect: &'static dyn Columns,
    pub(crate) place: usize,
    /// What `place` counts.
    pub(crate) site: Site,
    /// The second joint of a pair.
    pub(crate) other: Option<usize>,
    /// Name of the place; of a pair, the first joint's.
    pub(crate) name: String,
    pub(crate) scope: Vec<usize>,
    pub(crate) variants: Vec<Variant>,
}

impl Candidate {
    /// Effect name.
    pub(crate) fn effect_name(&self) -> &'static str {
        self.effect.entry().name
    }

    /// Names of all places, as the robot's files have them.
    pub(crate) fn places(&self, model: &Model) -> Vec<String> {
        let mut out = vec![self.name.clone()];
        out.extend(self.other.map(|j| model.joints[j].name.clone()));
        out
    }

    /// Whether it sits where another candidate does.
    pub(crate) fn is_where(&self, c: &Self) -> bool {
        (self.site, self.place, self.other) == (c.site, c.place, c.other)
    }
}

/// A candidate that has been accepted, with its shape and the numbers of its acceptance.
#[derive(Debug, Clone)]
pub(crate) struct Pick {
    pub(crate) candidate: usize,
    pub(crate) variant: Variant,
    /// Family-wise p-value of the search.
    pub(crate) p_search: f64,
    /// p-value of the test on held-out data; 1 before it.
    pub(crate) p_confirm: f64,
    /// Blocks in which it helped.
    pub(crate) wins: usize,
}

/// Everything a diagnosis works on.
pub(crate) struct Work<'w> {
    pub(crate) robot: &'w Robot,
    /// The model with ordinary effects of the robot file counted into its joints.
    pub(crate) baseline: Model,
    pub(crate) motions: &'w [Motion],
    pub(crate) design: Design,
    pub(crate) gram: Gram,
    pub(crate) candidates: Vec<Candidate>,
    pub(crate) standard: StandardIds,
    /// Size of an error of each rigid column.
    pub(crate) rigid_spread: Vec<f64>,
    pub(crate) picks: Vec<Pick>,
    pub(crate) softness: usize,
    /// Prior strength of the rigid parameters while structure is sought.
    pub(crate) kappa: f64,
    /// Share of the controller's command that each drive's recorded effort lacked before it was made good.
    pub(crate) missing: Vec<f64>,
    /// Whether inertias, frictions and offsets are fitted along with the picks, unnamed: a refit of them had taken up what the picks explain.
    pub(crate) is_refitted: bool,
    /// The fitted recordings as pushes are looked for in them.
    pushes: Option<Scan>,
    /// Weighted squared measured effort of each joint over the rows that are fitted.
    effort: Vec<f64>,
    /// How directions of motion pass through zero: [softness][tree joint].
    pub(crate) widths: Vec<Vec<Turn>>,
}

impl<'w> Work<'w> {
    /// Builds columns of every candidate, or of the named effects only, and weighs the joints by what was measured.
    pub(crate) fn new(robot: &'w Robot, motions: &'w mut [Motion], design: Design, band: f64, only: Option<&[&str]>) -> Self {
        let mut out = Self::unweighted(robot, motions, (design, band), only);
        out.weigh();
        out
    }

    /// The same of the named effects only, and the motions stay whole for whoever comes after.
    pub(crate) fn looking(robot: &'w Robot, motions: &'w [Motion], made: (Design, f64), only: &[&str]) -> Self {
        // Pushes are none of these.
        let mut out = Parts::of(robot, motions, made, Some(only)).assembled(robot, motions, None);
        out.weigh();
        out
    }

    /// The same with given weights of the joints, and of the named effects only: what was measured plays no part.
    pub(crate) fn planned(robot: &'w Robot, motions: &'w mut [Motion], band: f64, weight: &[f64], only: Option<&[&str]>) -> Self {
        let design = Design::new(robot, motions, band);
        let mut out = Self::unweighted(robot, motions, (design, band), only);
        out.design.weight.copy_from_slice(weight);
        out.rebuild();
        out.effort = out.effort_power();
        // The drive's chain moves the model as given.
        let models: Vec<_> = (0..SOFTNESS.len()).map(|w| (Vec::new(), Mat::zeros(0, 1), w)).collect();
        out.refresh_chain(&models, band);
        out
    }

    fn unweighted(robot: &'w Robot, made_from: &'w mut [Motion], made: (Design, f64), only: Option<&[&str]>) -> Self {
        let parts = Parts::of(robot, made_from, made, only);
        let pushes = Scan::of(made_from);
        made_from.iter_mut().for_each(Motion::shed);
        parts.assembled(robot, made_from, pushes)
    }

    /// Weights each joint by what a plain refit leaves there, so that no joint drowns the others.
    fn weigh(&mut self) {
        let columns = self.every_model_has(0);
        let (ids, prior) = self.with_rigid(columns, 0.5);
        let targets = vec![self.measured_minus_nominal(0, View::Fit)];
        let cross = self.gram.cross(&self.design, &targets);
        let theta = screen::fit(&self.gram, &cross, &ids, &prior, Over::All);
        let left = self.residual(&ids, &theta, 0, View::Fit);
        for (j, left) in left.iter().enumerate() {
            let (mut sum, mut n) = (0.0, 0_usize);
            for (s, rows) in self.design.rows.iter().enumerate() {
                for i in (0..rows.time.len()).filter(|&i| rows.fold[i].is_some() && rows.valid[i] && rows.moving[j][i]) {
                    sum += left[s][i] * left[s][i];
                    n += 1;
                }
            }
            let rms = pkm_dyn::math::sqrt(sum / n.max(1) as f64);
            self.design.weight[j] = if rms > 0.0 { 1.0 / rms } else { 1.0 };
        }
        self.rebuild();
        self.effort = self.effort_power();
    }

    /// Squared measured effort of each joint over the rows that are fitted, in units of what a plain refit leaves there.
    fn effort_power(&self) -> Vec<f64> {
        let mut measured = self.measured();
        for (j, of_joint) in measured.iter_mut().enumerate() {
            for (x, rows) in of_joint.iter_mut().zip(&self.design.rows) {
                x.iter_mut().zip(&rows.weight[j]).for_each(|(x, weight)| *x /= weight);
            }
        }
        let cross = self.gram.cross(&self.design, &vec![measured]);
        let folds = &cross.yy[..self.gram.n_folds];
        let worth = |j: usize| if j < self.design.n_drives { 1.0 } else { POSITION_WORTH * POSITION_WORTH };
        (0..self.design.n_joints).map(|j| worth(j) * folds.iter().map(|f| f[j][0]).sum::<f64>()).collect()
    }

    fn measured(&self) -> Vec<Vec<Vec<f64>>> {
        let d = &self.design;
        (0..d.n_joints).map(|j| (0..d.rows.len()).map(|s| d.measured_rows(j, s, View::Fit)).collect()).collect()
    }

    /// Weighted squared effort of some joints.
    pub(crate) fn effort_over(&self, joints: &[usize]) -> f64 {
        joints.iter().map(|&j| self.effort[j]).sum()
    }

    /// Size of a squared error as a share of the effort of some joints.
    pub(crate) fn of_effort(&self, squared: f64, joints: &[usize]) -> f64 {
        let effort = self.effort_over(joints);
        if effort > 0.0 { pkm_dyn::math::sqrt(squared.max(0.0) / effort) } else { 0.0 }
    }

    /// Drives and other measured positions of a scope apart, those that are there: the size of an effect is judged where it shows most, and
    /// the whole effort of all drives would make a shift of one position look like nothing.
    pub(crate) fn kinds_of_rows(&self, scope: &[usize]) -> Vec<Vec<usize>> {
        let (drives, positions): (Vec<usize>, Vec<usize>) = scope.iter().partition(|&&j| j < self.design.n_drives);
        [drives, positions].into_iter().filter(|part| !part.is_empty()).collect()
    }

    /// Sums of products anew, after columns or chains changed.
    pub(crate) fn rebuild(&mut self) {
        self.gram = Gram::new(&self.design);
    }

    /// What `ask` says with the lag or delay that was found at a joint taken out.
    pub(crate) fn with_chain_out<T>(&mut self, joint: usize, ask: impl FnOnce(&Self) -> T) -> T {
        let chain = self.design.chain[joint];
        self.design.chain[joint] = self.design.given_chain[joint];
        self.rebuild();
        let out = ask(self);
        self.design.chain[joint] = chain;
        self.rebuild();
        out
    }

    /// Friction and offsets of the drives at a softness, and how it may turn over: what every model has besides inertias.
    pub(crate) fn every_model_has(&self, softness: usize) -> Vec<ColumnId> {
        let s = &self.standard;
        s.offset.iter().chain(&s.viscous).chain(&s.coulomb[softness]).chain(&s.turning).copied().collect()
    }

    /// Adds the inertial parameters with prior strength `kappa` (0: none at all); returns ids and inverse prior variances.
    pub(crate) fn with_rigid(&self, mut ids: Vec<ColumnId>, kappa: f64) -> (Vec<ColumnId>, Vec<f64>) {
        let mut prior = vec![0.0; ids.len()];
        if kappa > 0.0 {
            for (&id, spread) in self.standard.rigid.iter().zip(&self.rigid_spread) {
                if !ids.contains(&id) {
                    ids.push(id);
                    prior.push(self.inverse_variance(id, kappa * spread));
                }
            }
        }
        (ids, prior)
    }

    /// Inverse prior variance of a coefficient in the units fits are solved in.
    pub(crate) fn inverse_variance(&self, id: ColumnId, sd: f64) -> f64 {
        if sd.is_finite() && sd > 0.0 {
            let scaled = self.gram.scale[id] / sd;
            scaled * scaled
        } else {
            0.0
        }
    }

    /// Columns of everything picked, and of what is fitted along, each once, with inverse prior variances.
    pub(crate) fn picked(&self, without: Option<usize>) -> (Vec<ColumnId>, Vec<f64>) {
        self.picked_but(without.as_slice())
    }

    /// The same without several picks.
    pub(crate) fn picked_but(&self, without: &[usize]) -> (Vec<ColumnId>, Vec<f64>) {
        let along = if self.is_refitted { self.every_model_has(self.softness) } else { Vec::new() };
        let (mut ids, mut prior) = self.with_rigid(along, if self.is_refitted { self.kappa } else { 0.0 });
        for (_, p) in self.picks.iter().enumerate().filter(|(i, _)| !without.contains(i)) {
            for (&id, &sd) in p.variant.columns.iter().zip(&p.variant.prior) {
                if !ids.contains(&id) {
                    ids.push(id);
                    prior.push(self.inverse_variance(id, sd));
                }
            }
        }
        (ids, prior)
    }

    /// What the model as given leaves of the measured effort: [joint][segment][row].
    pub(crate) fn measured_minus_nominal(&self, softness: usize, view: View) -> Vec<Vec<Vec<f64>>> {
        let d = &self.design;
        (0..d.n_joints)
            .map(|j| {
                (0..d.rows.len())
                    .map(|s| d.measured_rows(j, s, view).iter().zip(d.nominal_rows(softness, j, s, view)).map(|(y, m)| y - m).collect())
                    .collect()
            })
            .collect()
    }

    /// What a fit leaves: [joint][segment][row]. `theta` is columns × 1.
    pub(crate) fn residual(&self, ids: &[ColumnId], theta: &Mat<f64>, softness: usize, view: View) -> Vec<Vec<Vec<f64>>> {
        let mut left = self.measured_minus_nominal(softness, view);
        for (i, &id) in ids.iter().enumerate() {
            for j in self.design.joints_of(id) {
                for (s, left) in left[j].iter_mut().enumerate() {
                    if let Some(x) = self.design.values(id, j, s, view) {
                        left.iter_mut().zip(x).for_each(|(l, x)| *l -= theta[(i, 0)] * x);
                    }
                }
            }
        }
        left
    }

    /// The fitted model upstream of the drive's chain, on the fine grid: [segment].
    pub(crate) fn acting(&self, joint: usize, ids: &[ColumnId], theta: &Mat<f64>, softness: usize) -> Vec<Vec<f64>> {
        let mut out: Fine = self.design.nominal[softness][joint].plain.iter().map(Stored::read).collect();
        for (i, &id) in ids.iter().enumerate() {
            if let Some((_, pair)) = self.design.columns[id].joints.iter().find(|(j, _)| *j == joint) {
                for (sum, x) in out.iter_mut().zip(&pair.plain) {
                    sum.iter_mut().zip(x.read()).for_each(|(s, x)| *s += theta[(i, 0)] * x);
                }
            }
        }
        out
    }

    /// Makes the chain candidates' columns from the fitted models, one model per softness: (columns, coefficients, softness).
    pub(crate) fn refresh_chain(&mut self, models: &[(Vec<ColumnId>, Mat<f64>, usize)], band: f64) {
        let chain: Vec<usize> = (0..self.candidates.len()).filter(|&c| self.candidates[c].effect.family() == Family::Chain).collect();
        // A drive has a lag and a delay to choose from, and one rate for both.
        let has_chain = |j: &usize| chain.iter().any(|&c| self.candidates[c].scope[0] == *j);
        let drives: Vec<usize> = (0..self.design.n_drives).filter(has_chain).filter(|&j| self.design.is_seldom_clean(j)).collect();
        // Rows of surplus drives are sums over several chains: theirs are sought on clean rows only.
        let alone = if self.design.is_shared() { &[] } else { models };
        for (ids, theta, softness) in alone {
            for &j in &drives {
                self.design.late[*softness][j] = self.late(j, ids, theta, *softness);
            }
        }
        for c in chain {
            let drive = self.candidates[c].scope[0];
            let mut old: Vec<ColumnId> = self.candidates[c].variants.iter().flat_map(|v| v.columns.clone()).collect();
            old.reverse();
            // A picked chain column stays where it is; only its series is renewed.
            let mut variants = Vec::new();
            for (ids, theta, softness) in models {
                let acting = self.acting(drive, ids, theta, *softness);
                for (plain, values) in self.chain_shapes(c, &acting, band) {
                    let cut = self.design.late[*softness][drive].clone();
                    let id = self.design.put_fine(old.pop(), drive, (plain, &cut));
                    variants.push(Variant {
                        values,
                        softness: Some(*softness),
                        columns: vec![id],
                        prior: vec![f64::INFINITY],
                        n_own: 1,
                        limit: None,
                    });
                }
            }
            self.candidates[c].variants = variants;
        }
        self.rebuild();
    }

    /// Rate of the fitted model upstream of the chain, with standstill cut out after the derivative and before the filter: [segment]. Dry
    /// friction and the model as given come from raw samples; of what else is fitted the filtered series will do.
    fn late(&self, joint: usize, ids: &[ColumnId], theta: &Mat<f64>, softness: usize) -> Fine {
        let acting = self.acting(joint, ids, theta, softness);
        let direction = self.standard.coulomb[softness][joint];
        let coulomb = ids.iter().position(|&id| id == direction).map_or(0.0, |i| theta[(i, 0)]);
        let dry = self.design.columns[direction].joints.iter().find(|(j, _)| *j == joint).map(|(_, pair)| &pair.plain);
        let nominal = &self.design.nominal[softness][joint].plain;
        let of_segment = |(s, m): (usize, &Motion)| {
            let grid = &self.design.fine[s];
            let (nominal, dry) = (nominal[s].read(), dry.map(|d| d[s].read()));
            let smooth = |i: usize| acting[s][i] - nominal[i] - dry.as_ref().map_or(0.0, |d| coulomb * d[i]);
            let rest: Vec<f64> = (0..acting[s].len()).map(smooth).collect();
            let sign = Motion::direction(&m.segment.v[joint], self.widths[softness][self.robot.model.actuators[joint]]);
            let raw: Vec<f64> =
                (0..sign.len()).map(|i| m.nominal[softness][joint][i] + coulomb * sign[i] + grid.between(&rest, i)).collect();
            self.design.without_standstill(s, joint, &derivative(&raw, m.segment.dt))
        };
        self.motions.iter().enumerate().map(of_segment).collect()
    }

    fn chain_shapes(&self, candidate: usize, acting: &[Vec<f64>], band: f64) -> Vec<(Vec<Vec<f64>>, Vec<f64>)> {
        let per = |f: &dyn Fn(&[f64], f64) -> Vec<f64>| acting.iter().zip(&self.design.fine).map(|(x, g)| f(x, g.dt)).collect();
        if self.candidates[candidate].effect_name() == "actuator_lag" {
            return vec![(per(&|x, dt| derivative(x, dt)), Vec::new())];
        }
        // Finite moves of the model: beyond a few hundredths of a period of the band, a delay is no longer its own derivative.
        [0.02, 0.06, 0.15]
            .into_iter()
            .map(|share| {
                let d = share / band;
                let moved = |x: &[f64], dt: f64| advanced(x, d, dt).iter().zip(x).map(|(m, x)| (m - x) / d).collect();
                (per(&moved), vec![d])
            })
            .collect()
    }

    /// Adds a pick; ordinary parameters it was sought together with become picks of their own.
    pub(crate) fn pick(&mut self, mut pick: Pick) {
        let n_own = pick.variant.n_own;
        let companions = pick.variant.columns.split_off(n_own);
        pick.variant.prior.truncate(n_own);
        for id in companions {
            let of = |c: &Candidate| c.effect.family() == Family::Standard && c.variants.iter().any(|v| v.columns == [id]);
            let Some(candidate) = self.candidates.iter().position(of) else { continue };
            if self.picks.iter().any(|p| p.candidate == candidate) {
                continue;
            }
            let variant =
                Variant { values: Vec::new(), softness: None, columns: vec![id], prior: vec![f64::INFINITY], n_own: 1, limit: None };
            self.picks.push(Pick { candidate, variant, ..pick.clone() });
        }
        self.picks.push(pick);
    }

    /// Takes a softness, for everything picked as well.
    pub(crate) fn set_softness(&mut self, softness: usize) {
        self.softness = softness;
        for p in &mut self.picks {
            let same = |v: &&Variant| v.softness == Some(softness) && v.values == p.variant.values;
            if p.variant.softness.is_some()
                && let Some(v) = self.candidates[p.candidate].variants.iter().find(same)
            {
                p.variant = v.clone();
            }
        }
    }

    /// Measured minus nominal for each softness, as targets.
    pub(crate) fn real_targets(&self, softnesses: &[usize]) -> Targets {
        softnesses.iter().map(|&w| self.measured_minus_nominal(w, View::Fit)).collect()
    }

    /// Drive of a candidate's place, if it is a driven joint.
    pub(crate) fn drive(&self, candidate: usize) -> Option<usize> {
        let c = &self.candidates[candidate];
        let is_one_joint = c.site == Site::Joint && c.other.is_none();
        self.robot.model.actuators.iter().position(|&j| is_one_joint && j == c.place)
    }
}

impl Work<'_> {
    /// Chance that something looks as pushed as where a candidate is somewhere at some time, where nothing pushes.
    pub(crate) fn chance_of_push(&self, candidate: usize, settings: &Settings) -> f64 {
        let c = &self.candidates[candidate];
        let place = self.drive(candidate).map_or(Place::Link(c.place), Place::Drive);
        self.pushes.as_ref().map_or(1.0, |scan| scan.chance(place, settings))
    }
}

/// What is made of the motions before anything is compared.
struct Parts {
    design: Design,
    candidates: Vec<Candidate>,
    standard: StandardIds,
    rigid_spread: Vec<f64>,
    widths: Vec<Vec<Turn>>,
}

impl Parts {
    fn of(robot: &Robot, motions: &[Motion], (mut design, band): (Design, f64), only: Option<&[&str]>) -> Self {
        let model = &robot.model;
        let widths = widest_turns(motions);
        let standard = standard_columns(&mut design, motions, model, &widths);
        let (speeds, travel) = extents(motions, model.n_act());
        let massive = model.massive_links();
        let range = ranges(motions, model.n_act());
        let (top_speed, travel, massive) = (&speeds, &travel, &massive);
        let ctx = Context { model, widths: &widths, top_speed, travel, range: &range, motions, band, massive };
        let candidates = register(&ctx, &mut design, motions, &standard, only);
        let rigid_spread = massive.iter().flat_map(|&l| columns::inertia_error::spread(&model.links[l].parameters)).collect();
        Self { design, candidates, standard, rigid_spread, widths }
    }

    fn assembled<'w>(self, robot: &'w Robot, motions: &'w [Motion], pushes: Option<Scan>) -> Work<'w> {
        let Self { design, candidates, standard, rigid_spread, widths } = self;
        Work {
            robot,
            baseline: crate::refine::baseline(robot),
            motions,
            gram: Gram::new(&design),
            design,
            candidates,
            standard,
            rigid_spread,
            picks: Vec::new(),
            softness: 0,
            kappa: 0.0,
            missing: vec![0.0; robot.model.n_act()],
            is_refitted: false,
            pushes,
            effort: Vec::new(),
            widths,
        }
    }
}

fn standard_columns(design: &mut Design, motions: &[Motion], model: &Model, widths: &[Vec<Turn>]) -> StandardIds {
    let n = model.n_act();
    let n_rigid = model.massive_links().len() * N_INERTIAL;
    let each = |f: fn(&Motion, usize) -> Vec<f64>| -> Vec<Make> {
        (0..n).map(|k| Box::new(move |m: &Motion| vec![(k, f(m, k))]) as Make).collect()
    };
    let offset = design.push(motions, each(|m, _| vec![1.0; m.segment.valid.len()]));
    let viscous = design.push(motions, each(|m, k| m.segment.v[k].clone()));
    let coulomb = widths
        .iter()
        .map(|widths| {
            let sources = (0..n).map(|k| {
                let turn = widths[model.actuators[k]];
                Box::new(move |m: &Motion| vec![(k, Motion::direction(&m.segment.v[k], turn))]) as Make
            });
            design.push(motions, sources.collect())
        })
        .collect();
    let known: Vec<usize> = (0..n).filter(|&k| motions.iter().any(|m| m.turning_weight[k] > 0.0)).collect();
    let beyond = known.iter().flat_map(|&k| {
        let turn = move |w: usize| widths[w][model.actuators[k]];
        (1..widths.len()).map(move |w| {
            let (first, other) = (turn(0), turn(w));
            Box::new(move |m: &Motion| vec![(k, m.segment.v[k].iter().map(|v| other.sign(*v) - first.sign(*v)).collect())]) as Make
        })
    });
    let turning = design.push(motions, beyond.collect());
    let rigid =
        (0..n_rigid).map(|c| Box::new(move |m: &Motion| m.link_columns[c].iter().map(Tape::read).enumerate().collect()) as Make).collect();
    let rigid = design.push(motions, rigid);
    StandardIds { rigid, viscous, coulomb, offset, turning }
}

fn register(ctx: &Context, design: &mut Design, motions: &[Motion], standard: &StandardIds, only: Option<&[&str]>) -> Vec<Candidate> {
    let effects = columns::ALL.iter().filter(|e| only.is_none_or(|names| names.contains(&e.entry().name)));
    let proposals = effects.flat_map(|&effect| effect.propose(ctx).into_iter().map(move |p| (effect, p)));
    // All columns are made at once, on every core.
    let mut new = New { first: design.columns.len(), makes: Vec::new() };
    let proposed: Vec<_> = proposals
        .map(|(effect, p)| {
            let mut made = Vec::new();
            let variants: Vec<Variant> = p.shapes.into_iter().map(|shape| variant(shape, standard, (&mut new, &mut made))).collect();
            (Candidate { effect, place: p.place, site: p.site, other: p.other, name: p.name, scope: p.scope, variants }, effect.family())
        })
        .collect();
    design.push(motions, new.makes);
    let acts = |v: &Variant| v.columns.iter().any(|&c| design.joints_of(c).next().is_some());
    let mut out: Vec<Candidate> = Vec::new();
    for (mut c, family) in proposed {
        c.variants.retain(acts);
        if c.variants.is_empty() && family != Family::Chain {
            continue;
        }
        if design.is_shared() && c.scope.iter().any(|&j| j < design.n_drives) {
            // The drive itself stays first.
            let rest: Vec<usize> = (0..design.n_drives).filter(|j| !c.scope.contains(j)).collect();
            c.scope.extend(rest);
        }
        out.push(c);
    }
    out
}

/// Columns to come, in the order of their ids.
struct New {
    first: ColumnId,
    makes: Vec<Make>,
}

impl New {
    fn add(&mut self, make: Make) -> ColumnId {
        self.makes.push(make);
        self.first + self.makes.len() - 1
    }
}

/// `made` holds the new columns of the candidate's earlier shapes.
fn variant(shape: Shape, standard: &StandardIds, (new, made): (&mut New, &mut Vec<ColumnId>)) -> Variant {
    let mut columns = Vec::new();
    for source in shape.sources {
        columns.push(match source {
            Source::New(f) => {
                made.push(new.add(f));
                made[made.len() - 1]
            }
            Source::Again(i) => made[i],
            Source::Rigid(link, k) => standard.rigid[link * N_INERTIAL + k],
            Source::Viscous(k) => standard.viscous[k],
            Source::Coulomb(k, w) => standard.coulomb[w][k],
            Source::Offset(k) => standard.offset[k],
        });
    }
    Variant { values: shape.values, softness: shape.softness, columns, prior: shape.prior, n_own: shape.n_own, limit: shape.limit }
}
