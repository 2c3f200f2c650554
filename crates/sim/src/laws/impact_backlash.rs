//! Play with blows: an inertia behind a gap is hit at both ends and rebounds.

use pkm_dyn::effects::{JointState, Unit};

use super::{ForeignLaw, Form, optional, required};

pub(super) const FORM: Form = Form {
    effects: &["backlash"],
    name: "impact",
    equation: "an inertia within ± gap/2 of the joint; at the ends its velocity relative to the joint becomes −restitution times itself, and \
               the joint feels the blow",
    parameters: &[
        required("gap", Unit::Position, 0.0),
        required("inertia", Unit::Inertia, 0.0),
        optional("restitution", Unit::Share, 0.0, 0.3),
    ],
    build: |joint, p| {
        Box::new(Impact { joint, gap: p[0], inertia: p[1], restitution: p[2], place: 0.0, velocity: None, owed: 0.0, over: 0.0, blow: 0.0 })
    },
};

/// Blows within one step before the rest of it is spent at the end of the play.
const BLOWS: usize = 16;

/// The joint's motion is taken as given within a step, as if it were much heavier than what rattles; what it loses by the blows it feels
/// as an effort over what comes next, so that momentum is kept however steps are divided.
#[derive(Debug, Clone)]
struct Impact {
    joint: usize,
    gap: f64,
    inertia: f64,
    restitution: f64,
    /// Position of the inertia relative to the joint `[m | rad]`.
    place: f64,
    /// Its velocity; before the first step that of the joint.
    velocity: Option<f64>,
    /// Momentum of the blows that the joint has not felt yet `[N·s | N·m·s]`.
    owed: f64,
    /// Longest stretch so far: what is owed is spread over it `[s]`.
    over: f64,
    /// Effort by which it is felt `[N | N·m]`.
    blow: f64,
}

impl ForeignLaw for Impact {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, _: &JointState) -> (f64, f64) {
        (self.blow, self.blow)
    }

    fn advance(&mut self, state: &JointState, h: f64) {
        let start = self.velocity.unwrap_or(state.v);
        let (mut relative, mut left, end) = (start - state.v, h, 0.5 * self.gap);
        for _ in 0..BLOWS {
            let way = (if relative > 0.0 { end } else { -end }) - self.place;
            if relative.abs() * left <= way.abs() || relative.abs() <= 0.0 {
                break;
            }
            left -= (way / relative).max(0.0);
            self.place += way;
            relative *= -self.restitution;
        }
        self.place = (self.place + relative * left).clamp(-end, end);
        let velocity = state.v + relative;
        // The stretch that ends has felt its share; a shorter one than the longest leaves a rest.
        self.owed += self.inertia * (velocity - start) - self.blow * h;
        self.over = self.over.max(h);
        self.blow = self.owed / self.over;
        self.velocity = Some(velocity);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blows_come_when_the_gap_is_crossed_and_leave_the_restitution() {
        let (h, v, e) = (1e-3, 0.1, 0.5);
        let mut law =
            Impact { joint: 0, gap: 0.02, inertia: 2.0, restitution: e, place: 0.0, velocity: Some(0.0), owed: 0.0, over: 0.0, blow: 0.0 };
        let state = JointState { v, ..JointState::default() };
        let (mut momentum, mut times) = (0.0, Vec::new());
        for i in 0..2000 {
            law.advance(&state, h);
            let (low, high) = law.levels(&state);
            assert!((low - high).abs() < 1e-15);
            momentum += low * h;
            if low.abs() > 0.0 {
                times.push((h * f64::from(i), law.velocity.unwrap()));
            }
        }
        // Half the gap at 0.1 m/s; then the whole gap at half the speed, and so on.
        for (k, (want, left)) in [(0.1, -e), (0.1 + 0.4, e * e), (0.5 + 0.8, -e * e * e)].into_iter().enumerate() {
            assert!((times[k].0 - want).abs() < 1.1 * h, "blow {k} at {}", times[k].0);
            // It first trails the joint at −v, and each blow turns and halves that.
            assert!((times[k].1 - v + left * v).abs() < 1e-12, "blow {k}: {}", times[k].1);
        }
        let kept = 2.0 * law.velocity.unwrap();
        assert!((momentum - kept).abs() < 1e-12, "{momentum} {kept}");
    }

    #[test]
    fn momentum_is_kept_where_steps_are_divided() {
        let mut law = Impact {
            joint: 0,
            gap: 0.02,
            inertia: 2.0,
            restitution: 0.5,
            place: 0.0,
            velocity: Some(0.0),
            owed: 0.0,
            over: 0.0,
            blow: 0.0,
        };
        let state = JointState { v: 0.1, ..JointState::default() };
        let mut felt = 0.0;
        for i in 0..9000 {
            // Each step is cut at an event of some other joint.
            let h = [1e-3, 1e-9, 0.4e-3, 0.6e-3 - 1e-9][i % 4];
            felt += law.levels(&state).0 * h;
            law.advance(&state, h);
            assert!(law.levels(&state).0.abs() <= 2.0 * 0.2 / 1e-3);
        }
        let gained = 2.0 * law.velocity.unwrap();
        assert!((felt - gained).abs() < 1e-9, "{felt} {gained}");
    }

    #[test]
    fn without_restitution_it_rides_along() {
        let mut law =
            Impact { joint: 0, gap: 0.0, inertia: 2.0, restitution: 0.0, place: 0.0, velocity: None, owed: 0.0, over: 0.0, blow: 0.0 };
        let h = 1e-3;
        for i in 0..100 {
            law.advance(&JointState { v: 3.0 * h * f64::from(i), ..JointState::default() }, h);
        }
        // Nothing but its inertia is felt.
        assert!((law.levels(&JointState::default()).0 - 6.0).abs() < 1e-9);
    }
}
