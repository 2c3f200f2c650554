//! An observation matrix along a stated motion: what is exported for another program, and what is compared with its answer.

use faer::Mat;
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::{Data, math};
use pkm_ident::columns::Columns;
use pkm_ident::excitation::{Basis, Periodic};

/// Columns of the five-bar linkage that are independent of each other along the motion.
pub(crate) const COLUMNS: [&str; 9] = [
    "distal_left.mx",
    "distal_left.izz",
    "shoulder_left.rotor_inertia",
    "shoulder_right.rotor_inertia",
    "shoulder_left.viscous",
    "shoulder_left.coulomb",
    "shoulder_right.viscous",
    "shoulder_right.coulomb",
    "shoulder_left.offset",
];

const SAMPLES: usize = 50;

/// The matrix, drive by drive within a sample.
pub(crate) fn observation() -> Mat<f64> {
    let shipped = pkm_robots::find("five_bar").expect("a shipped robot");
    let parsed = pkm_dyn::urdf::parse(shipped.toml, shipped.urdf, [shipped.toml_name, shipped.urdf_name]);
    let robot = parsed.expect("shipped robots load").robot;
    let model = &robot.model;
    let columns = Columns::new(&robot);
    let kept: Vec<usize> = COLUMNS.iter().map(|c| columns.index(c).unwrap_or_else(|| panic!("column {c}"))).collect();
    let motion = Periodic {
        basis: Basis::Fourier { harmonics: 3 },
        period_s: 4.0,
        coefficients: vec![vec![0.05, 0.3, -0.2, 0.15, 0.25, -0.4, 0.1], vec![-0.03, -0.25, 0.3, 0.35, -0.1, 0.2, 0.3]],
    };
    let mut data = Data::new(model);
    let mut out = Mat::zeros(SAMPLES * model.n_act(), kept.len());
    assert!(assemble(model, &mut data).is_closed);
    for i in 0..SAMPLES {
        let s = motion.at(motion.period_s * i as f64 / SAMPLES as f64);
        assert!(i > 0 || walk_to(model, &mut data, &s.q).is_closed);
        assert!(closed_loop_motion(model, &mut data, &s.q, &s.v, &s.a).is_closed);
        let direction: Vec<f64> = data.v.iter().map(|v| math::sign(*v)).collect();
        let n = model.n_act();
        columns.fill(model, &mut data, &direction, &mut |k, c, x| {
            if let Some(j) = kept.iter().position(|&kept| kept == c) {
                out[(i * n + k, j)] = x;
            }
        });
    }
    out
}
