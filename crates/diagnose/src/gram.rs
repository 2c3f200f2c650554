//! Sums of products from which every fit is solved: nothing after this file touches samples again while candidates are compared.

use faer::Mat;
use rayon::prelude::*;

use crate::design::{ColumnId, Design, View};

/// Sums of products over the fitted rows, per fold and joint, of every column with every column and with every target.
#[derive(Debug)]
pub(crate) struct Gram {
    /// Folds that are fitted.
    pub(crate) n_folds: usize,
    /// Columns that act on each joint.
    pub(crate) active: Vec<Vec<ColumnId>>,
    /// Place of a column in its joint's list: [joint][column].
    pub(crate) local: Vec<Vec<Option<usize>>>,
    /// Column with column: [fold][joint]; after the folds that are fitted comes one of everything held out.
    pub(crate) xx: Vec<Vec<Mat<f64>>>,
    /// The same summed over the fitted folds: [joint].
    pub(crate) xx_all: Vec<Mat<f64>>,
    /// One over the weighted rms of each column: fits are solved in these units.
    pub(crate) scale: Vec<f64>,
    stacks: Vec<Vec<Stack>>,
}

/// Weighted rows of one fold and joint.
#[derive(Debug)]
struct Stack {
    x: Mat<f64>,
    /// Segment and row of each line.
    at: Vec<(usize, usize)>,
}

/// Products of the columns with a set of targets.
#[derive(Debug)]
pub(crate) struct Cross {
    /// Column with target: [fold][joint], columns × targets.
    pub(crate) xy: Vec<Vec<Mat<f64>>>,
    /// The same summed over the fitted folds: [joint].
    pub(crate) xy_all: Vec<Mat<f64>>,
    /// Target with itself: [fold][joint][target].
    pub(crate) yy: Vec<Vec<Vec<f64>>>,
}

/// Targets by joint and segment, at the rows: [target][joint][segment][row].
pub(crate) type Targets = Vec<Vec<Vec<Vec<f64>>>>;

impl Gram {
    pub(crate) fn new(design: &Design) -> Self {
        let n_columns = design.columns.len();
        let mut active = vec![Vec::new(); design.n_joints];
        let mut local = vec![vec![None; n_columns]; design.n_joints];
        for (id, column) in design.columns.iter().enumerate() {
            for &(j, _) in &column.joints {
                local[j][id] = Some(active[j].len());
                active[j].push(id);
            }
        }
        let stacks = stacks(design, &active);
        let scale = scales(n_columns, &active, &stacks[..design.n_folds]);
        let xx: Vec<Vec<Mat<f64>>> = stacks.par_iter().map(|joints| joints.iter().map(|s| s.x.transpose() * &s.x).collect()).collect();
        let xx_all = summed(&xx[..design.n_folds]);
        Self { n_folds: design.n_folds, active, local, xx, xx_all, scale, stacks }
    }

    /// Weighted squared length of a column at one joint over the fitted rows, in the units fits are solved in.
    pub(crate) fn power(&self, id: ColumnId, joint: usize) -> f64 {
        let scale = self.scale[id];
        self.local[joint][id].map_or(0.0, |l| self.xx_all[joint][(l, l)] * scale * scale)
    }

    /// Squared length at one joint of a sum of columns, by their places among the joint's, over the fitted rows: each row as large as it is, whatever its
    /// weight in fits.
    pub(crate) fn felt(&self, design: &Design, joint: usize, sum: &[(usize, f64)]) -> f64 {
        let of_row = |s: &Stack, i: usize, (segment, row): (usize, usize)| {
            let x: f64 = sum.iter().map(|(column, c)| c * s.x[(i, *column)]).sum();
            let x = x / design.rows[segment].weight[joint][row];
            x * x
        };
        let of_fold =
            |joints: &Vec<Stack>| -> f64 { joints[joint].at.iter().enumerate().map(|(i, at)| of_row(&joints[joint], i, *at)).sum() };
        self.stacks[..self.n_folds].iter().map(of_fold).sum()
    }

    /// Number of fitted folds that hold any row: a gap may empty one.
    pub(crate) fn n_filled(&self) -> usize {
        self.stacks[..self.n_folds].iter().filter(|joints| joints.iter().any(|s| !s.at.is_empty())).count()
    }

    /// Products with `targets`.
    pub(crate) fn cross(&self, design: &Design, targets: &Targets) -> Cross {
        let of_stack = |(j, stack): (usize, &Stack)| {
            let y = Mat::from_fn(stack.at.len(), targets.len(), |i, b| {
                let (segment, row) = stack.at[i];
                design.weight[j] * targets[b][j][segment][row]
            });
            let yy: Vec<f64> = (0..targets.len()).map(|b| y.col(b).iter().map(|v| v * v).sum()).collect();
            (stack.x.transpose() * &y, yy)
        };
        let of_joints = |joints: &Vec<Stack>| -> (Vec<Mat<f64>>, Vec<Vec<f64>>) { joints.iter().enumerate().map(of_stack).unzip() };
        let (xy, yy): (Vec<_>, Vec<_>) = self.stacks.par_iter().map(of_joints).unzip();
        let xy_all = summed(&xy[..self.n_folds]);
        Cross { xy, xy_all, yy }
    }
}

/// Sum over folds of each joint's matrix.
fn summed(folds: &[Vec<Mat<f64>>]) -> Vec<Mat<f64>> {
    let mut sums = folds.first().map_or_else(Vec::new, Clone::clone);
    for fold in folds.iter().skip(1) {
        sums.iter_mut().zip(fold).for_each(|(sum, x)| *sum += x);
    }
    sums
}

fn stacks(design: &Design, active: &[Vec<ColumnId>]) -> Vec<Vec<Stack>> {
    let mut lines: Vec<Vec<Vec<(usize, usize)>>> = vec![vec![Vec::new(); design.n_joints]; design.n_folds + 1];
    for (segment, rows) in design.rows.iter().enumerate() {
        for (row, fold) in rows.fold.iter().enumerate() {
            if !rows.valid[row] {
                continue;
            }
            for (j, lines) in lines[fold.unwrap_or(design.n_folds)].iter_mut().enumerate() {
                if rows.moving[j][row] {
                    lines.push((segment, row));
                }
            }
        }
    }
    // Values are computed once per column and segment, dealt out to the folds, and gone: of a long recording they are as large as the stacks.
    let by_joint: Vec<Vec<Mat<f64>>> = active
        .par_iter()
        .enumerate()
        .map(|(j, ids)| {
            let mut folds: Vec<Mat<f64>> = lines.iter().map(|joints| Mat::zeros(joints[j].len(), ids.len())).collect();
            for (c, &id) in ids.iter().enumerate() {
                let values: Vec<Vec<f64>> =
                    (0..design.rows.len()).map(|s| design.values(id, j, s, View::Fit).unwrap_or_default()).collect();
                for (x, joints) in folds.iter_mut().zip(&lines) {
                    joints[j].iter().enumerate().for_each(|(i, &(s, row))| x[(i, c)] = design.weight[j] * values[s][row]);
                }
            }
            folds
        })
        .collect();
    let mut columns: Vec<_> = by_joint.into_iter().map(Vec::into_iter).collect();
    let of_fold = |joints: Vec<Vec<(usize, usize)>>| {
        joints.into_iter().zip(&mut columns).filter_map(|(at, folds)| Some(Stack { x: folds.next()?, at })).collect()
    };
    lines.into_iter().map(of_fold).collect()
}

fn scales(n_columns: usize, active: &[Vec<ColumnId>], stacks: &[Vec<Stack>]) -> Vec<f64> {
    let mut square = vec![0.0; n_columns];
    let mut count = 0_usize;
    for joints in stacks {
        for (j, s) in joints.iter().enumerate() {
            count += s.at.len();
            for (c, &id) in active[j].iter().enumerate() {
                square[id] += s.x.col(c).iter().map(|v| v * v).sum::<f64>();
            }
        }
    }
    let n = count.max(1) as f64;
    square.into_iter().map(|s: f64| if s > 0.0 { 1.0 / pkm_dyn::math::sqrt(s / n) } else { 0.0 }).collect()
}
