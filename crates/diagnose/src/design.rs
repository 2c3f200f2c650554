//! The regression: filtered columns per joint, blocks, weights, and the sums of products from which every fit is solved.
//!
//! A row is one decimated sample of one actuated joint. Columns that act on one joint only are stored for that joint only. Nothing
//! after this file touches samples again while candidates are compared: all fits, folds and null runs work on sums of products.

use pkm_dyn::effects::{Law, Robot};
use pkm_ident::filter::{advanced, derivative};
use rayon::prelude::*;

use crate::extents::extents;
use crate::motion::Motion;
use crate::rows::{FineGrid, Rows, folds, left_out, rows, standstill};
use crate::settings::SOFTNESS;
use crate::sharing::Sharing;
use crate::shelf::{Shelf, Stored};

/// Index of a column in the whole design.
pub(crate) type ColumnId = usize;

/// Lag and delay already found at a joint.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Chain {
    pub(crate) lag: f64,
    pub(crate) delay: f64,
}

/// Filtered series on the fine grid; [segment].
pub(crate) type Fine = Vec<Vec<f64>>;

/// A filtered series twice, by segment: as it is, on the fine grid, for a chain may yet be run over it, and at the rows; and with standstill
/// set to zero before the filter, at the rows.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pair {
    pub(crate) plain: Vec<Stored>,
    at_rows: Vec<Stored>,
    cut: Vec<Stored>,
}

impl Pair {
    /// Adds a segment with `n` rows; both series are on the fine grid.
    fn put(&mut self, shelf: &Shelf, (grid, n): (&FineGrid, usize), plain: Vec<f64>, cut: Option<&[f64]>) {
        self.at_rows.push(shelf.put(grid.at_rows(&plain, n)));
        self.cut.push(shelf.put(cut.map_or_else(|| vec![0.0; n], |x| grid.at_rows(x, n))));
        self.plain.push(shelf.put(plain));
    }
}

/// One column: per joint it acts on, its filtered series.
#[derive(Debug, Clone)]
pub(crate) struct Column {
    pub(crate) joints: Vec<(usize, Pair)>,
}

/// Which rows of a series are meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum View {
    /// As fits see them: standstill cut out.
    Fit,
    /// As the verdict judges them: standstill included.
    Judge,
}

/// Everything of the regression that does not depend on which columns are chosen.
#[derive(Debug)]
pub(crate) struct Design {
    /// Drives, then other positions that are measured: everything with rows of its own.
    pub(crate) n_joints: usize,
    /// Drives alone.
    pub(crate) n_drives: usize,
    pub(crate) n_folds: usize,
    pub(crate) fine: Vec<FineGrid>,
    pub(crate) rows: Vec<Rows>,
    pub(crate) columns: Vec<Column>,
    /// Measured effort, [joint].
    pub(crate) measured: Vec<Pair>,
    /// Effort of the model as given before its chain, [softness][joint].
    pub(crate) nominal: Vec<Vec<Pair>>,
    pub(crate) chain: Vec<Chain>,
    pub(crate) given_chain: Vec<Chain>,
    /// Rate of the effort before the chain, standstill cut out of it as of everything: what a chain takes per second where the rows are not
    /// clean, [softness][joint].
    pub(crate) late: Vec<Vec<Fine>>,
    /// Weight of each joint's rows: one over what a plain refit leaves.
    pub(crate) weight: Vec<f64>,
    /// Raw samples at which each joint stands still and is left out: [segment][joint].
    still: Vec<Vec<Vec<bool>>>,
    /// How surplus drives share efforts, by segment; empty without any.
    sharing: Vec<Sharing>,
    /// Where all columns lie.
    pub(crate) shelf: Shelf,
}

/// Makes a column's raw series for one segment.
pub(crate) type Make = Box<dyn Fn(&Motion) -> Series + Send + Sync>;

/// Raw series of a column in one segment: per joint it acts on.
pub(crate) type Series = Vec<(usize, Vec<f64>)>;

impl Design {
    /// Rows, folds and measured efforts; columns come with [`Design::push`].
    pub(crate) fn new(robot: &Robot, motions: &[Motion], band: f64) -> Self {
        let n_drives = robot.model.n_act();
        let n_joints = n_drives + motions.first().map_or(0, |m| m.channels.len());
        let fine: Vec<FineGrid> = motions.iter().map(|m| FineGrid::new(m.segment.dt, band)).collect();
        let (folds, n_folds) = folds(motions);
        let (top, _) = extents(motions, n_drives);
        let stands: Vec<Vec<Vec<bool>>> = motions.iter().map(|m| standstill(m, &top, band)).collect();
        let still: Vec<Vec<Vec<bool>>> = motions.iter().zip(&stands).map(|(m, stands)| left_out(m, stands)).collect();
        let sharing: Vec<Sharing> = motions.iter().zip(&still).filter_map(|(m, still)| Sharing::of(m, still)).collect();
        let mut rows: Vec<Rows> = (0..motions.len()).map(|s| rows(&motions[s], &fine[s], &folds[s], (&stands[s], &still[s]))).collect();
        if !sharing.is_empty() {
            rows.iter_mut().for_each(|r| clean_together(&mut r.clean[..n_drives]));
        }
        let shelf = motions.first().map_or_else(Shelf::default, |m| m.segment.shelf.clone());
        let pairs = |of: &dyn Fn(&Motion) -> Vec<Vec<f64>>| {
            let mut out = vec![Pair::default(); n_joints];
            for (s, motion) in motions.iter().enumerate() {
                let series: Series = of(motion).into_iter().enumerate().collect();
                let cut = cut(&series, &still[s], sharing.get(s));
                for ((pair, (_, plain)), (_, cut)) in out.iter_mut().zip(&series).zip(&cut) {
                    pair.put(&shelf, (&fine[s], rows[s].time.len()), fine[s].fine(plain), Some(&fine[s].fine(cut)));
                }
            }
            out
        };
        let with_channels = |m: &Motion, efforts: &[Vec<f64>], which: usize| -> Vec<Vec<f64>> {
            let channel = |c: &crate::channels::Channel| c.rows(&m.segment.valid)[which].clone();
            efforts.iter().cloned().chain(m.channels.iter().map(channel)).collect()
        };
        let measured = pairs(&|m| with_channels(m, &m.segment.tau, 0));
        let nominal = (0..SOFTNESS.len()).map(|w| pairs(&|m| with_channels(m, &m.nominal[w], 1))).collect();
        let mut given_chain: Vec<Chain> = robot
            .model
            .actuators
            .iter()
            .map(|&j| Chain {
                lag: robot.chain(j, |law| matches!(law, Law::EffortLag)).sum(),
                delay: robot.chain(j, |law| matches!(law, Law::EffortDelay)).sum(),
            })
            .collect();
        given_chain.resize(n_joints, Chain::default());
        let late = vec![vec![Fine::new(); n_joints]; SOFTNESS.len()];
        Self {
            n_joints,
            n_drives,
            n_folds,
            fine,
            rows,
            columns: Vec::new(),
            measured,
            nominal,
            chain: given_chain.clone(),
            given_chain,
            late,
            weight: vec![1.0; n_joints],
            still,
            sharing,
            shelf,
        }
    }

    /// Whether there are more drives than freedoms, so that what one drive does is in the rows of all.
    pub(crate) fn is_shared(&self) -> bool {
        !self.sharing.is_empty()
    }

    /// Drives per freedom: 1 unless there are more drives than freedoms.
    pub(crate) fn drives_per_freedom(&self) -> f64 {
        self.sharing.first().map_or(1.0, |s| self.n_drives as f64 / s.freedoms())
    }

    /// Adds columns given by their raw series per segment, filtered here exactly as the effort is; returns their ids.
    pub(crate) fn push(&mut self, motions: &[Motion], sources: Vec<Make>) -> Vec<ColumnId> {
        let (fine, still, sharing, rows, shelf) = (&self.fine, &self.still, &self.sharing, &self.rows, &self.shelf);
        let new: Vec<Column> = sources
            .par_iter()
            .map(|source| {
                let mut joints: Vec<(usize, Pair, bool)> = Vec::new();
                for (s, motion) in motions.iter().enumerate() {
                    let series = source(motion);
                    let (whole, cut) = (sharing.get(s).map(|x| x.whole(&series)), cut(&series, &still[s], sharing.get(s)));
                    let whole = whole.unwrap_or(series);
                    let raw: Vec<&[f64]> = whole.iter().chain(&cut).map(|(_, x)| x.as_slice()).collect();
                    let mut plain = fine[s].fine_each(&raw);
                    let cut = plain.split_off(whole.len());
                    for (((joint, _), plain), cut) in whole.into_iter().zip(plain).zip(cut) {
                        let at = joints.iter().position(|(j, ..)| *j == joint).unwrap_or_else(|| {
                            joints.push((joint, Pair::default(), false));
                            joints.len() - 1
                        });
                        let (_, pair, acts) = &mut joints[at];
                        *acts |= plain.iter().any(|x| x.abs() > 0.0);
                        pair.put(shelf, (&fine[s], rows[s].time.len()), plain, Some(&cut));
                    }
                }
                // A column that is zero everywhere acts nowhere.
                Column { joints: joints.into_iter().filter(|(.., acts)| *acts).map(|(j, pair, _)| (j, pair)).collect() }
            })
            .collect();
        let first = self.columns.len();
        self.columns.extend(new);
        (first..self.columns.len()).collect()
    }

    /// Whether most of the rows in which a joint moves have a standstill within the filter's reach. A lag or delay is then sought in these as
    /// well, to first order; where clean rows abound, the first order would only bend what they say.
    pub(crate) fn is_seldom_clean(&self, joint: usize) -> bool {
        let (mut clean, mut moving) = (0_usize, 0_usize);
        for rows in &self.rows {
            for i in (0..rows.time.len()).filter(|&i| rows.valid[i] && rows.moving[joint][i]) {
                moving += 1;
                clean += usize::from(rows.clean[joint][i]);
            }
        }
        2 * clean < moving
    }

    /// A raw series of a joint, filtered with its standstill cut out, on the fine grid.
    pub(crate) fn without_standstill(&self, segment: usize, joint: usize, raw: &[f64]) -> Vec<f64> {
        let cut: Vec<f64> = raw.iter().zip(&self.still[segment][joint]).map(|(x, still)| if *still { 0.0 } else { *x }).collect();
        self.fine[segment].fine(&cut)
    }

    /// Adds a column that is already filtered and on the fine grid, plain and with standstill cut out of it, or replaces one. Fits see those
    /// without a cut, and those of surplus drives, on clean rows only.
    pub(crate) fn put_fine(&mut self, at: Option<ColumnId>, joint: usize, (plain, cut): (Fine, &Fine)) -> ColumnId {
        let stored = |plain: Fine, cut: &Fine| {
            let mut out = Pair::default();
            for (s, x) in plain.into_iter().enumerate() {
                out.put(&self.shelf, (&self.fine[s], self.rows[s].time.len()), x, cut.get(s).map(Vec::as_slice));
            }
            out
        };
        let spread = |k: usize| {
            let of_segment = |(s, x): (usize, &Vec<f64>)| self.sharing[s].thinned(joint, x, self.fine[s].step).swap_remove(k);
            (k, stored(plain.iter().enumerate().map(of_segment).collect(), &Fine::new()))
        };
        let joints = if self.is_shared() { (0..self.n_drives).map(spread).collect() } else { vec![(joint, stored(plain, cut))] };
        let column = Column { joints };
        match at {
            Some(id) => {
                self.columns[id] = column;
                id
            }
            None => {
                self.columns.push(column);
                self.columns.len() - 1
            }
        }
    }

    /// A fine series behind a joint's drive chain, as recorded effort. Rows of surplus drives are sums over chains: there the chain stays a
    /// column by itself, and recorded efforts are brought to what acts beforehand.
    pub(crate) fn through_chain(&self, chain: Chain, segment: usize, x: &[f64]) -> Vec<f64> {
        if self.is_shared() {
            return x.to_vec();
        }
        let dt = self.fine[segment].dt;
        let mut out = if chain.delay.abs() > 0.0 { advanced(x, chain.delay, dt) } else { x.to_vec() };
        if chain.lag.abs() > 0.0 {
            let rate = derivative(&out, dt);
            out.iter_mut().zip(rate).for_each(|(x, r)| *x += chain.lag * r);
        }
        out
    }

    fn thin(&self, segment: usize, x: &[f64]) -> Vec<f64> {
        self.fine[segment].at_rows(x, self.rows[segment].time.len())
    }

    fn view(&self, pair: &Pair, chain: Chain, (joint, segment): (usize, usize), view: View) -> Vec<f64> {
        let through = if chain == Chain::default() || self.is_shared() {
            pair.at_rows[segment].read()
        } else {
            self.thin(segment, &self.through_chain(chain, segment, &pair.plain[segment].read()))
        };
        if view == View::Judge {
            return through;
        }
        let cut = pair.cut[segment].read();
        let Rows { clean, weight, .. } = &self.rows[segment];
        let of_row = |((plain, cut), clean): ((&f64, f64), &bool)| if *clean { *plain } else { cut };
        through.iter().zip(cut).zip(&clean[joint]).map(of_row).zip(&weight[joint]).map(|(x, weight)| weight * x).collect()
    }

    /// A column's values at the rows of one joint and segment; `None` when it does not act there.
    pub(crate) fn values(&self, id: ColumnId, joint: usize, segment: usize, view: View) -> Option<Vec<f64>> {
        let (_, pair) = self.columns[id].joints.iter().find(|(j, _)| *j == joint)?;
        Some(self.view(pair, self.chain[joint], (joint, segment), view))
    }

    /// Measured effort at the rows of one joint and segment.
    pub(crate) fn measured_rows(&self, joint: usize, segment: usize, view: View) -> Vec<f64> {
        self.view(&self.measured[joint], Chain::default(), (joint, segment), view)
    }

    /// The model as given at the rows of one joint and segment, with the chain found so far.
    pub(crate) fn nominal_rows(&self, softness: usize, joint: usize, segment: usize, view: View) -> Vec<f64> {
        let chain = self.chain[joint];
        let mut out = self.view(&self.nominal[softness][joint], chain, (joint, segment), view);
        // Where rows are not clean the chain cannot be run, for it would drag the cut along; a lag and a delay are the same to first order.
        if let Some(rate) = self.late[softness][joint].get(segment).filter(|_| view == View::Fit) {
            let clean = &self.rows[segment].clean[joint];
            let rate = self.thin(segment, rate);
            let behind = out.iter_mut().zip(rate).zip(clean).filter(|(_, clean)| !**clean);
            behind.for_each(|((x, rate), _)| *x += (chain.lag + chain.delay) * rate);
        }
        out
    }

    /// The model as given, chain as given: what nothing has been added to. Directions are smoothed as in the model it is compared with.
    pub(crate) fn as_given_rows(&self, softness: usize, joint: usize, segment: usize, view: View) -> Vec<f64> {
        self.view(&self.nominal[softness][joint], self.given_chain[joint], (joint, segment), view)
    }

    /// Joints a column acts on.
    pub(crate) fn joints_of(&self, id: ColumnId) -> impl Iterator<Item = usize> + '_ {
        self.columns[id].joints.iter().map(|(j, _)| *j)
    }
}

/// Series with standstill taken out: set to zero, or of surplus drives projected away.
fn cut(series: &Series, still: &[Vec<bool>], sharing: Option<&Sharing>) -> Series {
    let mut out = sharing.map_or_else(|| series.clone(), |s| s.moving(series));
    for (j, x) in &mut out {
        // A drive that stands has no part in its own row either way.
        x.iter_mut().zip(&still[*j]).filter(|(_, still)| **still).for_each(|(x, _)| *x = 0.0);
    }
    out
}

/// What one drive's standstill does is in the rows of all that share with it.
fn clean_together(clean: &mut [Vec<bool>]) {
    let all: Vec<bool> = (0..clean.first().map_or(0, Vec::len)).map(|i| clean.iter().all(|c| c[i])).collect();
    clean.iter_mut().for_each(|c| c.clone_from(&all));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::motion;
    use crate::segment::Segment;
    use crate::testing::Bench;
    use crate::work::Work;

    #[test]
    fn products_are_the_same_to_the_bit_wherever_the_series_lie() {
        let bench = Bench::pair();
        let robot = Robot::new(bench.model.clone(), Vec::new());
        let products = |shelf: Shelf| {
            let segment = Segment { shelf: shelf.clone(), ..bench.motion.segment.clone() };
            let mut motions = vec![motion(&robot, segment).expect("sliders have no loops")];
            let work = Work::planned(&robot, &mut motions, 5.0, &[1.0, 1.0], None);
            let all = work.gram.xx_all.iter().flat_map(|x| (0..x.ncols()).flat_map(|c| x.col(c).iter().map(|v| v.to_bits()))).collect();
            (all, shelf.on_file())
        };
        let (here, nothing): (Vec<u64>, u64) = products(Shelf::default());
        let (there, filed) = products(Shelf::with_room(0, std::env::temp_dir()));
        assert!(nothing == 0 && filed > 1 << 20, "{nothing} and {filed} bytes in the file");
        assert!(here.len() > 1000 && here == there);
    }
}
