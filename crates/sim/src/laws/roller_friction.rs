//! Friction under load that rollers take over: it grows with the load and then no more.

use pkm_dyn::effects::{JointState, Unit};

use super::{ForeignLaw, Form, optional, required, set};

pub(super) const FORM: Form = Form {
    effects: &["friction_load"],
    name: "roller",
    equation: "(coulomb + mu·abs(load)/(1 + abs(load)/saturation))·s",
    parameters: &[required("mu", Unit::One, 0.0), required("saturation", Unit::Effort, 1e-9), optional("coulomb", Unit::Effort, 0.0, 0.0)],
    build: |joint, p| Box::new(Roller { joint, mu: p[0], saturation: p[1], coulomb: p[2] }),
};

#[derive(Debug, Clone)]
struct Roller {
    joint: usize,
    mu: f64,
    saturation: f64,
    coulomb: f64,
}

impl ForeignLaw for Roller {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, state: &JointState) -> (f64, f64) {
        let load = state.load.abs();
        set(state.v, |_, s| (self.coulomb + self.mu * load / (1.0 + load / self.saturation)) * s)
    }

    fn advance(&mut self, _: &JointState, _: f64) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_begins_as_load_friction_and_ends_at_the_saturation() {
        let law = Roller { joint: 0, mu: 0.1, saturation: 50.0, coulomb: 2.0 };
        let at = |load: f64| law.levels(&JointState { v: 0.1, load, ..JointState::default() }).1;
        assert!((at(0.0) - 2.0).abs() < 1e-15 && (at(-50.0) - 4.5).abs() < 1e-12);
        assert!(((at(1e-4) - 2.0) / 1e-5 - 1.0).abs() < 1e-5 && (at(1e9) - 7.0).abs() < 1e-5);
    }
}
