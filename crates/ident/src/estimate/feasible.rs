//! Physically consistent estimate: a convex program whose answer is a robot that can be built.
//!
//! A link's ten parameters are those of some mass distribution exactly when its 4 × 4 pseudo-inertia `P` is positive definite
//! \[Wensing2018\]. Every link is described relative to its nominal one, `P = L·S·Lᵀ` with `L·Lᵀ = P_nominal`, so `S = 1` is the nominal
//! link, whatever its size and unit. Minimised is
//!
//! `½·Σ (e/σ)²/n + g·(Σ_links D(S) + ½·Σ x²)`,   `D(S) = tr S − ln det S − 4`,
//!
//! with `D` the entropic (Bregman) divergence of the two mass distributions \[Lee2020\], infinite at the border of what is physical, and `x`
//! the other parameters' distance from their nominal values in units of what would move the drives by their whole effort. Near the nominal
//! link `D ≈ ½·‖S − 1‖²`, so a deviation by all of a link's mass and one by all of the drives' effort cost alike. What the recordings do not
//! show stays nominal; the weight `g` is chosen by cross-validation over blocks of time.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use nalgebra::Matrix4;
use pkm_dyn::parameters::{InertialParameters, N_INERTIAL};

use crate::columns::Columns;
use crate::factor::Factors;

/// Weights of the prior to choose from, per row: of no say against any motion, to a nominal robot that is trusted to some percent.
pub const PRIOR_WEIGHTS: [f64; 9] = [1e-7, 1e-6, 1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 1e-1];

/// Side of the gyration radius that a point, rod or plate of a nominal file is given, again and again until it has an extent `[m²]`.
const EXTENT: f64 = 4e-4;

/// Smallest eigenvalue of a nominal pseudo-inertia, as a share of its trace.
const THINNEST: f64 = 1e-6;

/// Smallest eigenvalue of `S` that the prior-free program allows: a body keeps a thousandth of its nominal extent in every direction.
const FLOOR: f64 = 1e-3;

/// Half of a 4 × 4 symmetric matrix, and of the 8 × 8 one that carries its determinant.
const HALF_4: usize = 10;
const HALF_8: usize = 36;

/// How links are drawn towards their nominal mass distribution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Prior {
    /// By the entropic divergence.
    Entropic,
    /// By its quadratic approximation at the nominal link, `½·‖S − 1‖²`: a quadratic program with matrix inequalities.
    Pullback,
}

/// How the program ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// To full accuracy.
    Solved,
    /// To reduced accuracy.
    Almost,
    /// Not at all; the estimate is the nominal robot.
    Failed,
}

/// The answer of the program.
#[derive(Debug, Clone, PartialEq)]
pub struct Feasible {
    /// All parameters.
    pub theta: Vec<f64>,
    /// How the program ended.
    pub outcome: Outcome,
    /// Iterations of the interior-point method.
    pub iterations: u32,
    /// Weight of the prior, per row.
    pub weight: f64,
    /// `½·‖S − 1‖²` of every link with mass: how far it moved from its nominal mass distribution.
    pub moved: Vec<f64>,
    /// Smallest eigenvalue of every link's `S`.
    pub smallest: Vec<f64>,
    /// How the answer may move.
    pub tangent: Tangent,
}

/// The surroundings of an answer: the directions that its active bounds leave free, and how firmly the prior holds them.
#[derive(Debug, Clone, PartialEq)]
pub struct Tangent {
    /// Change of all parameters per unit of each direction; parameters × directions.
    pub map: Mat<f64>,
    /// Second derivative of the prior, all rows together, in units of the noise; directions × directions.
    pub precision: Mat<f64>,
    /// Columns of the parameters that are at their bounds.
    pub at_bound: Vec<usize>,
}

/// A parameter closer to its bound than this share of what would move the drives by their whole effort is at it: the solver keeps to
/// 1e-8.
const AT_BOUND: f64 = 1e-6;

/// The same for the floor under the eigenvalues of a link.
const AT_FLOOR: f64 = 1e-5;

impl Space {
    /// Surroundings of the coordinates `x` with a prior of `weight` per row.
    fn tangent(&self, x: &[f64], rows: usize, prior: Prior, weight: f64) -> Tangent {
        let n = self.n();
        let mut precision = Mat::<f64>::zeros(n, n);
        (0..n).for_each(|j| precision[(j, j)] = 1.0);
        let mut active: Vec<Vec<f64>> = Vec::new();
        for l in 0..self.n_links {
            let eigen = Self::matrix(x, l).symmetric_eigen();
            let unit = |c: usize, length: f64, (i, j): (usize, usize)| {
                debug_assert!(c < HALF_4, "a coordinate of one link");
                let mut e = Matrix4::zeros();
                (e[(i, j)], e[(j, i)]) = (1.0 / length, 1.0 / length);
                e
            };
            let units: Vec<Matrix4<f64>> = half(4).enumerate().map(|(c, (i, j, length))| unit(c, length, (i, j))).collect();
            match prior {
                Prior::Entropic => {
                    // −ln det S bends by tr(S⁻¹·dS·S⁻¹·dS).
                    let inverse =
                        eigen.eigenvectors * Matrix4::from_diagonal(&eigen.eigenvalues.map(|s| 1.0 / s)) * eigen.eigenvectors.transpose();
                    for (i, a) in units.iter().enumerate() {
                        for (j, b) in units.iter().enumerate() {
                            precision[(l * HALF_4 + i, l * HALF_4 + j)] = (inverse * a * inverse * b).trace();
                        }
                    }
                }
                Prior::Pullback => {
                    let floor: Vec<usize> = (0..4).filter(|&k| eigen.eigenvalues[k] < FLOOR + AT_FLOOR).collect();
                    for (at, &k) in floor.iter().enumerate() {
                        for &m in &floor[at..] {
                            let (u, v) = (eigen.eigenvectors.column(k).into_owned(), eigen.eigenvectors.column(m).into_owned());
                            let mut row = vec![0.0; n];
                            units.iter().enumerate().for_each(|(c, e)| row[l * HALF_4 + c] = u.dot(&(e * v)));
                            active.push(row);
                        }
                    }
                }
            }
        }
        let mut at_bound = Vec::new();
        for (s, &(j, _)) in self.scalars.iter().enumerate() {
            let c = self.n_links * HALF_4 + s;
            if x[c] - self.lower[s] < AT_BOUND {
                let mut row = vec![0.0; n];
                row[c] = 1.0;
                active.push(row);
                at_bound.push(j);
            }
        }
        let free = beside(n, &active);
        let scale = rows as f64 * weight;
        Tangent { map: &self.map * &free, precision: free.transpose() * precision * &free * faer::Scale(scale), at_bound }
    }
}

/// Orthonormal directions of `n` coordinates at right angles to all of `rows`, as columns.
fn beside(n: usize, rows: &[Vec<f64>]) -> Mat<f64> {
    if rows.is_empty() {
        return Mat::identity(n, n);
    }
    let qr = Mat::from_fn(n, rows.len(), |i, j| rows[j][i]).qr();
    qr.compute_Q().subcols(rows.len(), n - rows.len()).to_owned()
}

/// Coordinates in which the nominal robot is simple: `theta = map · x + centre`.
#[derive(Debug, Clone)]
pub struct Space {
    map: Mat<f64>,
    centre: Vec<f64>,
    n_links: usize,
    /// Columns of the parameters after the links', and their units.
    scalars: Vec<(usize, f64)>,
    lower: Vec<f64>,
}

/// Entries of a symmetric matrix as a vector that keeps lengths: upper triangle by columns, off-diagonal ones times √2.
fn half(n: usize) -> impl Iterator<Item = (usize, usize, f64)> {
    (0..n).flat_map(|j| (0..=j).map(move |i| (i, j, if i == j { 1.0 } else { core::f64::consts::SQRT_2 })))
}

/// The nominal pseudo-inertia with enough extent to be inverted, and how much had to be added `[m²]`; `None` without mass.
#[must_use]
pub fn solid(parameters: &InertialParameters) -> Option<(Matrix4<f64>, f64)> {
    let mut p = parameters.pseudo_inertia();
    if !(parameters.mass > 0.0 && p.iter().all(|x| x.is_finite())) {
        return None;
    }
    let mut added = 0.0;
    // An inertia that is far too small needs more steps; each is larger than the last.
    let mut step = EXTENT;
    while p.symmetric_eigenvalues().min() < THINNEST * p.trace() {
        for i in 0..3 {
            p[(i, i)] += step * parameters.mass;
        }
        added += step;
        step *= 1.5;
    }
    Some((p, added))
}

impl Space {
    /// About the nominal robot; parameters not in `free` stay at `fixed`. `units` are the steps of the other parameters that would move
    /// the drives by their whole effort. `None` with a link that has no nominal body.
    #[must_use]
    pub fn new(columns: &Columns, free: &[usize], fixed: &[f64], units: &[f64]) -> Option<Self> {
        let n_links = columns.links.len();
        let scalars: Vec<(usize, f64)> = free.iter().filter(|&&j| j >= n_links * N_INERTIAL).map(|&j| (j, units[j])).collect();
        let mut map = Mat::zeros(columns.len(), n_links * HALF_4 + scalars.len());
        let mut centre = fixed.to_vec();
        let nominal = columns.nominal();
        for l in 0..n_links {
            let (p, _) = solid(&Columns::inertial(&nominal, l))?;
            let chol = p.cholesky()?.l();
            for (c, (i, j, length)) in half(4).enumerate() {
                let mut unit = Matrix4::zeros();
                (unit[(i, j)], unit[(j, i)]) = (1.0 / length, 1.0 / length);
                let theta = InertialParameters::from_pseudo_inertia(&(chol * unit * chol.transpose())).to_vector();
                for k in 0..N_INERTIAL {
                    map[(l * N_INERTIAL + k, l * HALF_4 + c)] = theta[k];
                }
            }
            centre[l * N_INERTIAL..(l + 1) * N_INERTIAL].fill(0.0);
        }
        for (s, &(j, unit)) in scalars.iter().enumerate() {
            map[(j, n_links * HALF_4 + s)] = unit;
            centre[j] = nominal[j];
        }
        let lower = scalars.iter().map(|&(j, unit)| (columns.list[j].lower - nominal[j]) / unit).collect();
        Some(Self { map, centre, n_links, scalars, lower })
    }

    fn n(&self) -> usize {
        self.map.ncols()
    }

    /// Coordinates of the nominal robot: `S = 1`, no deviation.
    fn nominal(&self) -> Vec<f64> {
        let mut x = vec![0.0; self.n()];
        for l in 0..self.n_links {
            for (c, (i, j, _)) in half(4).enumerate() {
                x[l * HALF_4 + c] = f64::from(u8::from(i == j));
            }
        }
        x
    }

    /// Parameters at the coordinates `x`.
    fn theta(&self, x: &[f64]) -> Vec<f64> {
        (0..self.map.nrows()).map(|i| self.centre[i] + (0..self.n()).map(|j| self.map[(i, j)] * x[j]).sum::<f64>()).collect()
    }

    /// A triangle in these coordinates: columns `x` and the rest of the target.
    fn seen(&self, triangle: &Mat<f64>) -> (Mat<f64>, Mat<f64>) {
        let p = self.map.nrows();
        let w = triangle.subcols(0, p);
        let centre = Mat::from_fn(p, 1, |i, _| self.centre[i]);
        let rest = Mat::from_fn(triangle.nrows(), 1, |i, _| triangle[(i, p)]) - w * centre;
        (w * &self.map, rest)
    }

    fn matrix(x: &[f64], l: usize) -> Matrix4<f64> {
        let mut s = Matrix4::zeros();
        for (c, (i, j, length)) in half(4).enumerate() {
            (s[(i, j)], s[(j, i)]) = (x[l * HALF_4 + c] / length, x[l * HALF_4 + c] / length);
        }
        s
    }
}

/// Prior weight per row by cross-validation over folds of time, with the inequalities left out: the ridge in `space`'s coordinates.
///
/// `noise` is each drive's standard deviation; the error is the mean squared weighted residual of the fold left out.
#[must_use]
pub fn choose_weight(factors: &Factors, noise: &[f64], space: &Space) -> f64 {
    let weights: Vec<f64> = noise.iter().map(|s| 1.0 / s).collect();
    let folds = factors.used_folds();
    let parts: Vec<_> = folds.iter().map(|&f| factors.weighted_where(&weights, &|g| g == f)).collect();
    let seen: Vec<_> = parts.iter().map(|p| space.seen(&p.triangle())).collect();
    let products = |(a, b): &(Mat<f64>, Mat<f64>)| (a.transpose() * a, a.transpose() * b);
    let each: Vec<_> = seen.iter().map(products).collect();
    let n = space.n();
    let (mut gram, mut right) = (Mat::<f64>::zeros(n, n), Mat::<f64>::zeros(n, 1));
    for (g, r) in &each {
        gram += g;
        right += r;
    }
    let start = Mat::from_fn(n, 1, |i, _| space.nominal()[i]);
    let total: usize = parts.iter().map(crate::factor::Factor::count).sum();
    let error = |weight: f64| -> f64 {
        let mut sum = 0.0;
        for ((part, (g, r)), (a, b)) in parts.iter().zip(&each).zip(&seen) {
            let soft = weight * (total - part.count()) as f64;
            let mut lhs = &gram - g;
            for i in 0..n {
                lhs[(i, i)] += soft;
            }
            let rhs = &right - r + &start * faer::Scale(soft);
            let Ok(llt) = lhs.llt(Side::Lower) else { return f64::INFINITY };
            let e = b - a * llt.solve(&rhs);
            sum += e.squared_norm_l2();
        }
        sum
    };
    let best = PRIOR_WEIGHTS.iter().map(|&w| (error(w), w)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or(PRIOR_WEIGHTS[0], |(_, w)| w)
}

/// The physically consistent estimate nearest to the rows of a weighted triangle (of `rows` rows) and, as far as `weight` has a say, to
/// the nominal robot.
#[must_use]
pub fn feasible(triangle: &Mat<f64>, rows: usize, space: &Space, prior: Prior, weight: f64) -> Feasible {
    let program = Program::new(triangle, rows, space, prior, weight);
    let (x, outcome, iterations) = program.solve();
    let x = if outcome == Outcome::Failed { space.nominal() } else { x[..space.n()].to_vec() };
    let tangent = space.tangent(&x, rows, prior, weight);
    let links: Vec<Matrix4<f64>> = (0..space.n_links).map(|l| Space::matrix(&x, l)).collect();
    let mut theta = space.theta(&x);
    // The solver keeps bounds to its tolerance only.
    for (s, &(j, unit)) in space.scalars.iter().enumerate() {
        theta[j] = theta[j].max(space.centre[j] + unit * space.lower[s]);
    }
    Feasible {
        theta,
        outcome,
        iterations,
        weight,
        moved: links.iter().map(|s| 0.5 * (s - Matrix4::identity()).norm_squared()).collect(),
        smallest: links.iter().map(|s| s.symmetric_eigenvalues().min()).collect(),
        tangent,
    }
}

/// Largest `t` with `S ⪰ t` for all links and friction within its bounds, such that the base parameters `combinations · theta` keep
/// the stated `values`: above zero exactly when some physical robot has them. Capped at 1; `None` when the solver fails, which it
/// does as well when the bounds alone contradict the values.
#[must_use]
pub fn margin(space: &Space, combinations: &Mat<f64>, values: &[f64]) -> Option<f64> {
    let n = space.n();
    let seen = combinations * &space.map;
    let mut rows = Rows::new(n + 1);
    for (i, value) in values.iter().enumerate() {
        let centre: f64 = (0..combinations.ncols()).map(|j| combinations[(i, j)] * space.centre[j]).sum();
        // Rows of very different units: each at length one.
        let length = (0..n).map(|j| seen[(i, j)] * seen[(i, j)]).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
        let entries: Vec<(usize, f64)> = (0..n).map(|j| (j, seen[(i, j)] / length)).filter(|(_, x)| x.abs() > 0.0).collect();
        rows.push(&entries, (value - centre) / length);
    }
    rows.close(SupportedConeT::ZeroConeT(values.len()));
    for l in 0..space.n_links {
        for (c, (i, j, _)) in half(4).enumerate() {
            let t = if i == j { vec![(n, 1.0)] } else { vec![] };
            rows.push(&[vec![(l * HALF_4 + c, -1.0)], t].concat(), 0.0);
        }
        rows.close(SupportedConeT::PSDTriangleConeT(4));
    }
    space.bounds(&mut rows);
    rows.push(&[(n, 1.0)], 1.0);
    rows.close(SupportedConeT::NonnegativeConeT(1));
    let mut q = vec![0.0; n + 1];
    q[n] = -1.0;
    let (x, outcome, _) = rows.minimise(&CscMatrix::zeros((n + 1, n + 1)), &q);
    (outcome != Outcome::Failed).then(|| x[n])
}

impl Space {
    /// Lower bounds of the other parameters as rows of a program.
    fn bounds(&self, rows: &mut Rows) {
        let mut count = 0;
        for (s, lower) in self.lower.iter().enumerate().filter(|(_, l)| l.is_finite()) {
            rows.push(&[(self.n_links * HALF_4 + s, -1.0)], -lower);
            count += 1;
        }
        if count > 0 {
            rows.close(SupportedConeT::NonnegativeConeT(count));
        }
    }
}

/// Constraints `A·x + s = b`, `s` in a product of cones, as they are gathered.
struct Rows {
    n: usize,
    at: (Vec<usize>, Vec<usize>, Vec<f64>),
    b: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
}

impl Rows {
    fn new(n: usize) -> Self {
        Self { n, at: (Vec::new(), Vec::new(), Vec::new()), b: Vec::new(), cones: Vec::new() }
    }

    fn push(&mut self, entries: &[(usize, f64)], b: f64) {
        for &(column, value) in entries {
            self.at.0.push(self.b.len());
            self.at.1.push(column);
            self.at.2.push(value);
        }
        self.b.push(b);
    }

    /// Rows pushed since the last cone are in this one.
    fn close(&mut self, cone: SupportedConeT<f64>) {
        self.cones.push(cone);
    }

    /// Minimises `½·xᵀ·P·x + qᵀ·x` (upper triangle of `P`).
    fn minimise(self, p: &CscMatrix<f64>, q: &[f64]) -> (Vec<f64>, Outcome, u32) {
        pkm_lapack_shim::link();
        let a = CscMatrix::new_from_triplets(self.b.len(), self.n, self.at.0, self.at.1, self.at.2);
        let mut settings = DefaultSettingsBuilder::default();
        settings.verbose(false).tol_gap_abs(1e-8).tol_gap_rel(1e-8).tol_feas(1e-8).max_iter(200);
        let failed = (vec![0.0; self.n], Outcome::Failed, 0);
        let Ok(settings) = settings.build() else { return failed };
        let Ok(mut solver) = DefaultSolver::new(p, q, &a, &self.b, &self.cones, settings) else { return failed };
        solver.solve();
        let outcome = match solver.solution.status {
            SolverStatus::Solved => Outcome::Solved,
            SolverStatus::AlmostSolved => Outcome::Almost,
            _ => Outcome::Failed,
        };
        if solver.solution.x.iter().any(|x| !x.is_finite()) {
            return failed;
        }
        (solver.solution.x, outcome, solver.solution.iterations)
    }
}

/// The program of [`feasible`]. Unknowns: the coordinates, then for the entropic prior per link a lower triangle `Z` and the logarithms of
/// its diagonal: `[S Z; Zᵀ diag Z] ⪰ 0` makes `ln det S ≥ Σ ln Z_ii`.
struct Program {
    p: CscMatrix<f64>,
    q: Vec<f64>,
    rows: Rows,
}

impl Program {
    fn new(triangle: &Mat<f64>, rows: usize, space: &Space, prior: Prior, weight: f64) -> Self {
        let (a, b) = space.seen(triangle);
        let per_row = 1.0 / rows.max(1) as f64;
        let (gram, right) = (a.transpose() * &a, a.transpose() * &b);
        let (n, links) = (space.n(), space.n_links);
        let total = n + if prior == Prior::Entropic { links * (HALF_4 + 4) } else { 0 };
        let start = space.nominal();
        let mut at = (Vec::new(), Vec::new(), Vec::new());
        let mut q = vec![0.0; total];
        for j in 0..n {
            let is_quadratic = prior == Prior::Pullback || j >= links * HALF_4;
            for i in 0..=j {
                let soft = if i == j && is_quadratic { weight } else { 0.0 };
                at.0.push(i);
                at.1.push(j);
                at.2.push(per_row * gram[(i, j)] + soft);
            }
            // The entropic pull is tr S − ln det S; the quadratic one is about the nominal coordinates.
            let pull = if is_quadratic { -weight * start[j] } else { weight * start[j] };
            q[j] = -per_row * right[(j, 0)] + pull;
        }
        let mut out = Self { p: CscMatrix::new_from_triplets(total, total, at.0, at.1, at.2), q, rows: Rows::new(total) };
        for l in 0..links {
            match prior {
                Prior::Entropic => out.entropic(l, n, weight),
                Prior::Pullback => out.bare(l),
            }
        }
        space.bounds(&mut out.rows);
        out
    }

    fn bare(&mut self, l: usize) {
        for (c, (i, j, _)) in half(4).enumerate() {
            self.rows.push(&[(l * HALF_4 + c, -1.0)], if i == j { -FLOOR } else { 0.0 });
        }
        self.rows.close(SupportedConeT::PSDTriangleConeT(4));
    }

    fn entropic(&mut self, l: usize, n: usize, weight: f64) {
        let z = n + l * (HALF_4 + 4);
        let logs = z + HALF_4;
        // Z by rows: (0,0), (1,0), (1,1), …
        let z_at = |i: usize, j: usize| z + i * (i + 1) / 2 + j;
        let before = self.rows.b.len();
        for (i, j, length) in half(8) {
            let entry = match (i < 4, j < 4) {
                (_, true) => vec![(l * HALF_4 + j * (j + 1) / 2 + i, -1.0)],
                (true, false) if i >= j - 4 => vec![(z_at(i, j - 4), -length)],
                (false, false) if i == j => vec![(z_at(i - 4, i - 4), -1.0)],
                _ => vec![],
            };
            self.rows.push(&entry, 0.0);
        }
        debug_assert_eq!(self.rows.b.len() - before, HALF_8, "half of an 8 × 8 matrix");
        self.rows.close(SupportedConeT::PSDTriangleConeT(8));
        for i in 0..4 {
            // exp(log) ≤ Z_ii
            self.rows.push(&[(logs + i, -1.0)], 0.0);
            self.rows.push(&[], 1.0);
            self.rows.push(&[(z_at(i, i), -1.0)], 0.0);
            self.rows.close(SupportedConeT::ExponentialConeT());
            self.q[logs + i] = -weight;
        }
    }

    fn solve(self) -> (Vec<f64>, Outcome, u32) {
        let Self { p, q, rows } = self;
        rows.minimise(&p, &q)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factor::Factor;
    use nalgebra::Vector4;
    use pkm_dyn::effects::Robot;

    /// A box on a hinge that rubs.
    fn robot() -> Robot {
        let urdf = r#"<robot name="p"><link name="base"/><link name="arm"><inertial><origin xyz="0.1 0.2 0.3"/><mass value="2"/>
            <inertia ixx="0.1" ixy="0.01" ixz="0.02" iyy="0.12" iyz="0.01" izz="0.15"/></inertial></link>
            <joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="1 0 0"/>
            <dynamics damping="0.5" friction="0.3"/></joint></robot>"#;
        let toml = "name = \"p\"\nurdf = \"p.urdf\"\n[[actuator]]\njoint = \"j\"\n";
        pkm_dyn::urdf::parse(toml, urdf, ["p.toml", "p.urdf"]).unwrap().robot
    }

    /// Rows that see every parameter by itself: `times` rows each, with the values `theta`.
    fn seen_directly(columns: &Columns, theta: &[f64], times: usize) -> Factor {
        let mut factor = Factor::new(columns.len());
        for j in 0..columns.len() {
            let mut row = vec![0.0; columns.len()];
            row[j] = 1.0;
            (0..times).for_each(|_| factor.push(&row, theta[j], theta[j]));
        }
        factor
    }

    fn run(columns: &Columns, theta: &[f64], prior: Prior, weight: f64) -> Feasible {
        let factor = seen_directly(columns, theta, 20);
        let free: Vec<usize> = (0..columns.len()).collect();
        let space = Space::new(columns, &free, &vec![0.0; columns.len()], &vec![1.0; columns.len()]).unwrap();
        feasible(&factor.triangle(), factor.count(), &space, prior, weight)
    }

    #[test]
    fn what_is_physical_and_seen_comes_back() {
        let columns = Columns::new(&robot());
        let mut theta = columns.nominal();
        theta.iter_mut().for_each(|x| *x *= 1.4);
        for prior in [Prior::Entropic, Prior::Pullback] {
            let answer = run(&columns, &theta, prior, 1e-9);
            assert_eq!(answer.outcome, Outcome::Solved, "{prior:?}");
            // A parameter at its bound is as far from it as the interior-point method's tolerance allows.
            assert!(answer.theta.iter().zip(&theta).all(|(a, b)| (a - b).abs() < 1e-3), "{prior:?}: {:?} {theta:?}", answer.theta);
        }
    }

    #[test]
    fn what_no_body_has_becomes_the_nearest_that_one_has() {
        let columns = Columns::new(&robot());
        let mut theta = columns.nominal();
        // Longer than the triangle inequality allows, and friction that drives.
        theta[9] += 1.0;
        let friction = columns.index("j.viscous").unwrap();
        theta[friction] = -1.0;
        let wanted = Columns::inertial(&theta, 0);
        assert!(!wanted.is_feasible(1e-9));
        for prior in [Prior::Entropic, Prior::Pullback] {
            let answer = run(&columns, &theta, prior, 1e-8);
            assert_ne!(answer.outcome, Outcome::Failed, "{prior:?}");
            let found = Columns::inertial(&answer.theta, 0);
            assert!(found.is_feasible(1e-9) && answer.smallest[0] > 0.0, "{prior:?}: {found:?}");
            assert!(answer.theta[friction].abs() < 1e-6, "{}", answer.theta[friction]);
            // The nearest point of a cone is where what is missing is at right angles to the point and at a blunt angle to every other
            // direction of the cone; those of bodies are mass points anywhere, v·vᵀ.
            // The quadratic prior comes with a floor under the extent, which keeps its answer a little inside.
            let tolerance = if prior == Prior::Pullback { 5e-3 } else { 1e-4 };
            let missing = wanted.to_vector() - found.to_vector();
            assert!(missing.dot(&found.to_vector()).abs() < tolerance * missing.norm(), "{prior:?}");
            for k in 0..200 {
                let v = Vector4::new(1.0, f64::from(k % 5), f64::from(k / 5 % 5), f64::from(k / 25)) - Vector4::new(0.5, 2.0, 2.0, 3.5);
                let point = InertialParameters::from_pseudo_inertia(&(v * v.transpose())).to_vector();
                assert!(missing.dot(&point) < tolerance * point.norm(), "{prior:?}: {v}");
            }
        }
    }

    #[test]
    fn the_tangent_has_the_curvature_of_the_prior_and_no_direction_through_a_bound() {
        let columns = Columns::new(&robot());
        let free: Vec<usize> = (0..columns.len()).collect();
        let space = Space::new(&columns, &free, &vec![0.0; columns.len()], &vec![1.0; columns.len()]).unwrap();
        // Some other body, and viscous friction at zero.
        let mut x = space.nominal();
        for (c, x) in x.iter_mut().take(HALF_4).enumerate() {
            *x += 0.1 * pkm_dyn::math::sin(1.0 + c as f64);
        }
        let viscous = columns.index("j.viscous").unwrap();
        let place = HALF_4 + space.scalars.iter().position(|s| s.0 == viscous).unwrap();
        // Dry friction is zero in the file as well: only the one that is meant stays there.
        x[HALF_4..].iter_mut().zip(&space.lower).for_each(|(x, lower)| *x = lower.max(*x) + 0.3);
        x[place] = space.lower[place - HALF_4];
        let tangent = space.tangent(&x, 7, Prior::Entropic, 0.5);
        assert_eq!(tangent.at_bound, [viscous]);
        assert!((0..tangent.map.ncols()).all(|c| tangent.map[(viscous, c)].abs() < 1e-12) && tangent.map.ncols() == space.n() - 1);
        let value = |x: &[f64]| {
            let s = Space::matrix(x, 0);
            s.trace() - pkm_dyn::math::ln(s.determinant()) - 4.0 + x[HALF_4..].iter().map(|x| 0.5 * x * x).sum::<f64>()
        };
        // Second differences along every free direction, of the prior of seven rows of weight a half.
        let directions = beside(space.n(), &[(0..space.n()).map(|c| f64::from(u8::from(c == place))).collect()]);
        for c in 0..directions.ncols() {
            let at = |t: f64| value(&x.iter().enumerate().map(|(i, x)| x + t * directions[(i, c)]).collect::<Vec<_>>());
            let bend = 3.5 * (at(1e-3) - 2.0 * at(0.0) + at(-1e-3)) / 1e-6;
            assert!((tangent.precision[(c, c)] / bend - 1.0).abs() < 1e-4, "{c}: {} {bend}", tangent.precision[(c, c)]);
        }
    }

    #[test]
    fn what_is_not_seen_stays_nominal() {
        let columns = Columns::new(&robot());
        let nominal = columns.nominal();
        let factor = Factor::new(columns.len());
        let free: Vec<usize> = (0..columns.len()).collect();
        let space = Space::new(&columns, &free, &vec![0.0; columns.len()], &vec![1.0; columns.len()]).unwrap();
        let answer = feasible(&factor.triangle(), 100, &space, Prior::Entropic, 1e-3);
        assert!(answer.theta.iter().zip(&nominal).all(|(a, b)| (a - b).abs() < 3e-3), "{:?} {nominal:?}", answer.theta);
    }

    #[test]
    fn the_margin_tells_bodies_from_others() {
        let columns = Columns::new(&robot());
        let free: Vec<usize> = (0..columns.len()).collect();
        let space = Space::new(&columns, &free, &vec![0.0; columns.len()], &vec![1.0; columns.len()]).unwrap();
        // Mass and one inertia are stated, all else is free.
        let rows = Mat::from_fn(2, columns.len(), |i, j| f64::from(u8::from(j == 9 * i)));
        assert!(margin(&space, &rows, &[2.0, 0.3]).unwrap() > 0.0);
        assert!(margin(&space, &rows, &[-1.0, 0.3]).is_none_or(|t| t <= 0.0));
        let friction = Mat::from_fn(1, columns.len(), |_, j| f64::from(u8::from(Some(j) == columns.index("j.coulomb"))));
        assert!(margin(&space, &friction, &[0.2]).unwrap() > 0.0);
        assert!(margin(&space, &friction, &[-0.2]).is_none_or(|t| t <= 0.0));
    }

    #[test]
    fn points_and_plates_are_given_an_extent() {
        let point = InertialParameters::from_centre_of_mass(1.0, [0.1, 0.0, 0.0].into(), nalgebra::Matrix3::zeros());
        let (p, added) = solid(&point).unwrap();
        assert!(added > 0.0 && added < 1e-2 && p.symmetric_eigenvalues().min() > 0.0);
        assert!(solid(&InertialParameters::default()).is_none());
    }
}
