//! The model in the loop: what the weight asks of the drives, and where a wrench sensor's axes point.

use pkm_dyn::Data;
use pkm_dyn::constrained::reduced_mass_matrix;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, drive_jacobian, solve_positions};
use pkm_dyn::model::Model;
use pkm_hal::MAX_AXES;

/// A wrench: force first `[N, N·m]`.
pub type Wrench = [f64; 6];

/// A model with the pose it was last weighed at.
pub struct Weigher {
    model: Model,
    data: Data,
    zero: Vec<f64>,
    /// The assembly, and the gap that its loops keep if they do.
    home: Vec<f64>,
    open: Option<f64>,
    /// Where a walk began, and where it is.
    walk: [Vec<f64>; 2],
    is_placed: bool,
}

/// Longest way of a drive that is gone at once `[m | rad]`: one jump over a long way can land on another assembly of the same loops.
const STRIDE: f64 = 0.01;

/// Most parts of a way: a period has to end.
const MOST_PARTS: u32 = 64;

impl core::fmt::Debug for Weigher {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Weigher").field("robot", &self.model.name).field("is_placed", &self.is_placed).finish_non_exhaustive()
    }
}

impl Weigher {
    /// A model that has been nowhere.
    #[must_use]
    pub fn new(model: Model) -> Self {
        let (mut data, zero) = (Data::new(&model), vec![0.0; model.n_act()]);
        let closure = assemble(&model, &mut data);
        let (home, open) = (data.q.clone(), (!closure.is_closed).then_some(closure.gap));
        let walk = [zero.clone(), zero.clone()];
        Self { model, data, zero, home, open, walk, is_placed: false }
    }

    /// Efforts that hold the robot with its drives at `q` `[m | rad]`, into `tau` `[N | N·m]`; the slices have the model's drives.
    ///
    /// # Errors
    /// The gap that its loops keep there `[m | rad]`. It then begins anew from its assembly.
    pub fn weigh(&mut self, q: &[f64], tau: &mut [f64; MAX_AXES]) -> Result<(), f64> {
        if !self.is_placed {
            if let Some(gap) = self.open {
                return Err(gap);
            }
            self.data.q.copy_from_slice(&self.home);
            self.walk_to(q)?;
            self.is_placed = true;
        }
        let closure = inverse_dynamics(&self.model, &mut self.data, q, &self.zero, &self.zero);
        self.is_placed = closure.is_closed;
        if !closure.is_closed {
            return Err(closure.gap);
        }
        for (to, from) in tau.iter_mut().zip(self.data.tau_act.iter()) {
            *to = *from;
        }
        Ok(())
    }

    /// Goes from the pose in `data` to positions of the drives, without allocating.
    fn walk_to(&mut self, q: &[f64]) -> Result<(), f64> {
        let (model, data, [start, way]) = (&self.model, &mut self.data, &mut self.walk);
        start.iter_mut().zip(&model.actuators).for_each(|(s, &j)| *s = data.q[j]);
        let far = start.iter().zip(q).map(|(s, q)| (q - s).abs()).fold(0.0, f64::max);
        let mut parts = 1;
        // Surplus drives contradict each other between two poses: there is no straight way to go.
        while parts < MOST_PARTS && f64::from(parts) * STRIDE < far && data.n_ind() == model.n_act() {
            parts += 1;
        }
        for part in 1..=parts {
            let share = f64::from(part) / f64::from(parts);
            way.iter_mut().zip(start.iter()).zip(q).for_each(|((w, s), q)| *w = s + share * (q - s));
            let closure = solve_positions(model, data, way);
            if !closure.is_closed {
                return Err(closure.gap);
            }
        }
        Ok(())
    }

    /// A wrench in the axes of sensor number `sensor` of the model, turned into the root's axes at the pose weighed last.
    #[must_use]
    pub fn in_root_axes(&self, sensor: usize, wrench: &Wrench) -> Wrench {
        let Some(sensor) = self.model.sensors.get(sensor) else { return *wrench };
        let link = &self.model.links[sensor.link];
        let pose = link.body.map_or(link.pose, |body| self.data.pose_wb[body].compose(&link.pose)).compose(&sensor.pose);
        let turned = |x: &[f64]| pose.rotation * nalgebra::Vector3::new(x[0], x[1], x[2]);
        let (force, moment) = (turned(&wrench[..3]), turned(&wrench[3..]));
        [force.x, force.y, force.z, moment.x, moment.y, moment.z]
    }
}

/// What each drive of `model` moves at the assembly while the others are free: `1/(D·M⁻¹·Dᵀ)_kk` with the reduced mass matrix `M` and the
/// drives' `D` `[kg | kg·m²]`; 0 where the robot does not close there.
#[must_use]
pub fn reflected(model: &Model) -> Vec<f64> {
    let mut data = Data::new(model);
    let none = vec![0.0; model.n_act()];
    if !assemble(model, &mut data).is_closed {
        return none;
    }
    let Some(inverse) = reduced_mass_matrix(model, &mut data).clone().try_inverse() else { return none };
    let drives = drive_jacobian(model, &mut data);
    let mobility = drives * inverse * drives.transpose();
    let mass = |k: usize| Some(mobility[(k, k)].recip()).filter(|mass| mass.is_finite() && *mass > 0.0);
    (0..model.n_act()).map(|k| mass(k).unwrap_or(0.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_drive_moves_is_what_it_needs_to_accelerate() {
        let robot = pkm_robots::find("prs3").expect("shipped");
        let model = pkm_dyn::urdf::parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("it loads").robot.model;
        let mass = reflected(&model);
        // The same from forces: columns of the mass matrix by inverse dynamics, `tau(a = e_k) - tau(0)`, inverted.
        let mut data = Data::new(&model);
        assert!(assemble(&model, &mut data).is_closed);
        let q: Vec<f64> = model.actuators.iter().map(|&j| data.q[j]).collect();
        let mut tau = |a: [f64; 3]| {
            assert!(inverse_dynamics(&model, &mut data, &q, &[0.0; 3], &a).is_closed);
            nalgebra::Vector3::new(data.tau_act[0], data.tau_act[1], data.tau_act[2])
        };
        let weight = tau([0.0; 3]);
        let columns = [tau([1.0, 0.0, 0.0]), tau([0.0, 1.0, 0.0]), tau([0.0, 0.0, 1.0])].map(|tau| tau - weight);
        let inverse = nalgebra::Matrix3::from_columns(&columns).try_inverse().expect("masses");
        for k in 0..3 {
            let want = 1.0 / inverse[(k, k)];
            assert!(want > 1.0 && (mass[k] - want).abs() < 1e-9 * want, "{} not {want}", mass[k]);
        }
    }
}
