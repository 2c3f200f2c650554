//! A delay that is another in every period.

use alloc::collections::VecDeque;

use pkm_dyn::effects::{JointState, Unit};

use super::{ForeignLaw, Form, optional, required};
use crate::random::{Random, Stream};

pub(super) const FORM: Form = Form {
    effects: &["time_delay"],
    name: "jitter",
    equation: "load(t) − load(t − d), d uniform within delay ± jitter, another in every step: what a drive lacks that answers late",
    parameters: &[required("delay", Unit::Second, 0.0), optional("jitter", Unit::Second, 0.0, 1e-3), optional("seed", Unit::One, 0.0, 1.0)],
    build: |joint, p| {
        let [delay, jitter] = [p[0].min(MOST), p[1].min(MOST)];
        Box::new(Jitter {
            joint,
            delay,
            jitter,
            random: Random::new(p[2].to_bits(), Stream::Jitter),
            past: VecDeque::new(),
            lacking: 0.0,
            time: 0.0,
        })
    },
};

/// Longest delay `[s]`: what lies further back is forgotten.
const MOST: f64 = 1.0;

/// The effort sent is not the joint's to know: the load that the rigid robot puts on the drive stands for it.
#[derive(Debug, Clone)]
struct Jitter {
    joint: usize,
    delay: f64,
    jitter: f64,
    random: Random,
    /// Times and loads, oldest first.
    past: VecDeque<(f64, f64)>,
    /// Load now less load a delay ago `[N | N·m]`.
    lacking: f64,
    time: f64,
}

impl Jitter {
    /// Load at a time of the past, on the line between those known; before them all it stood.
    fn load(&self, time: f64) -> f64 {
        let after = self.past.partition_point(|(t, _)| *t < time);
        let Some(&(t1, l1)) = self.past.get(after).or(self.past.back()) else { return 0.0 };
        let (t0, l0) = if after == 0 { (t1, l1) } else { self.past[after - 1] };
        if t1 > t0 { l0 + (l1 - l0) * ((time - t0) / (t1 - t0)).min(1.0) } else { l1 }
    }
}

impl ForeignLaw for Jitter {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, _: &JointState) -> (f64, f64) {
        (self.lacking, self.lacking)
    }

    fn advance(&mut self, state: &JointState, h: f64) {
        self.time += h;
        self.past.push_back((self.time, state.load));
        while self.past.front().is_some_and(|(t, _)| *t < self.time - 2.0 * MOST - h) {
            self.past.pop_front();
        }
        let delay = (self.delay + self.random.uniform(-self.jitter, self.jitter)).max(0.0);
        self.lacking = state.load - self.load(self.time - delay);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::math;

    fn run(jitter: f64, seed: u64) -> Vec<f64> {
        let random = Random::new(seed, Stream::Jitter);
        let mut law = Jitter { joint: 0, delay: 0.0105, jitter, random, past: VecDeque::new(), lacking: 0.0, time: 0.0 };
        let mut out = Vec::new();
        for i in 1..=1000 {
            let state = JointState { load: math::sin(5e-3 * f64::from(i)), ..JointState::default() };
            law.advance(&state, 1e-3);
            out.push(law.levels(&state).0);
        }
        out
    }

    #[test]
    fn without_jitter_it_is_a_delay() {
        for (i, lacking) in run(0.0, 1).iter().enumerate().skip(20) {
            let t = 5.0 * 1e-3 * (i as f64 + 1.0);
            assert!((lacking - (math::sin(t) - math::sin(t - 5.0 * 0.0105))).abs() < 1e-5, "step {i}");
        }
    }

    #[test]
    fn jitter_spreads_uniformly_about_the_delay_and_comes_back_with_its_seed() {
        let (a, b, c) = (run(0.004, 1), run(0.004, 1), run(0.004, 2));
        assert!(a == b && a != c);
        // Where the load's slope is nearly 5/s, delays can be read off it.
        let delays: Vec<f64> = a[20..60].iter().map(|x| x / 5.0).collect();
        assert!(delays.iter().all(|d| *d > 0.0059 && *d < 0.0146), "{delays:?}");
        let spread = delays.iter().fold(0.0_f64, |top, d| top.max((d - 0.0105).abs()));
        assert!(spread > 0.003, "{spread}");
    }
}
