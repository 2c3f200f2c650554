//! What a joint does beyond rigid bodies, as other programs have it: rotor, viscous and Coulomb friction, one linear spring.

use crate::effects::{Applied, Law, Robot};

/// Physics of one joint, nominal values and effects together.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct JointPhysics {
    /// Rotor inertia `[kg | kg·m²]`.
    pub(super) armature: f64,
    /// Viscous friction `[N·s/m | N·m·s/rad]`.
    pub(super) viscous: f64,
    /// Coulomb friction `[N | N·m]`.
    pub(super) coulomb: f64,
    /// Stiffness of the spring `[N/m | N·m/rad]`.
    pub(super) stiffness: f64,
    /// Effort of the spring at coordinate zero, the other way `[N | N·m]`.
    moment: f64,
}

impl JointPhysics {
    /// Where the spring pulls with no effort `[m | rad]`.
    pub(super) fn rest(&self) -> f64 {
        self.moment / self.stiffness
    }

    fn add(&mut self, effect: &Applied) {
        let p = &effect.values;
        match effect.entry.name {
            "friction_viscous" => self.viscous += p[0],
            "friction_coulomb" => self.coulomb += p[0],
            "friction_passive" => (self.coulomb, self.viscous) = (self.coulomb + p[0], self.viscous + p[1]),
            "rotor_inertia" => self.armature += p[0],
            "spring" if !is_bent(effect) => (self.stiffness, self.moment) = (self.stiffness + p[0], self.moment + p[0] * p[1]),
            _ => {}
        }
    }
}

/// A spring whose effort is no straight line: other formats have none.
fn is_bent(effect: &Applied) -> bool {
    effect.entry.name == "spring" && effect.values[2].abs() > 0.0
}

/// Physics of joint `j` of the robot.
pub(super) fn physics(robot: &Robot, j: usize) -> JointPhysics {
    let joint = &robot.model.joints[j];
    let mut out = JointPhysics { armature: joint.armature, viscous: joint.viscous, coulomb: joint.coulomb, ..JointPhysics::default() };
    for e in robot.effects.iter().filter(|e| e.is_at_joint(j) && matches!(e.entry.law, Law::JointEffort(_))) {
        out.add(e);
    }
    out
}

/// Effects that neither [`physics`] nor the model has in it, one line each.
pub(super) fn left_out(robot: &Robot, also: &[&str]) -> Vec<String> {
    let is_known = |e: &Applied| {
        let is_summed = ["friction_viscous", "friction_coulomb", "friction_passive", "rotor_inertia", "spring"].contains(&e.entry.name);
        let is_in_the_model = e.entry.law.is_in_the_model();
        (is_summed || is_in_the_model) && !also.contains(&e.entry.name) && !is_bent(e)
    };
    let line = |e: &Applied| {
        format!("effect {} at {:?} is left out: the format has no place for it", e.entry.name, e.place_names(&robot.model).join(","))
    };
    robot.effects.iter().filter(|e| !is_known(e)).map(line).collect()
}
