//! The position problem: from the sliders to the platform.

use pkm_dyn::{Data, Model, math};

use crate::error::PaperError;
use crate::robot::{closed_at, shipped};
use crate::row::{Gate, Row};

/// Radius of the base, length of a coupler, distance of the spheres on the platform `[m]`.
pub(super) const R_B: f64 = 0.384_516;
pub(super) const L_R: f64 = 0.513_997;
pub(super) const L_M: f64 = 0.516_003;

/// Heights of the sliders q1, q6, q8 that the mended equations give for the pose z = −0.40 m, pitch 0.10, roll −0.12 rad `[m]`.
const SLIDERS: [f64; 3] = [0.076_704_41, 0.090_951_40, 0.151_332_68];

/// Height `[m]`, pitch and roll `[rad]` that these sliders belong to, then the parasitic x, y `[m]` and yaw `[rad]`.
const POSE: [(&str, f64); 6] = [
    ("height, m", -0.40),
    ("pitch, rad", 0.10),
    ("roll, rad", -0.12),
    ("parasitic x, m", 0.000_316_33),
    ("parasitic y, m", 0.001_782_16),
    ("parasitic yaw, rad", -0.006_012_2),
];

/// Height `[m]`, pitch, roll `[rad]`, then the parasitic x, y `[m]` and yaw `[rad]` of the platform's centre in the pose that `data` holds.
pub(super) fn pose_of_platform(model: &Model, data: &Data) -> Result<[f64; 6], PaperError> {
    let reason = "no link of that name".to_string();
    let link = model.link_index("platform").ok_or(PaperError::Robot { name: "prs3", reason })?;
    let pose = model.links[link].body.map(|body| data.pose_wb[body]).unwrap_or_default();
    let centre = pose.transform_point(&[-L_M / math::sqrt(3.0), 0.0, 0.0].into());
    let r = pose.rotation;
    Ok([centre.z, math::asin(-r[(2, 0)]), math::atan2(r[(2, 1)], r[(2, 2)]), centre.x, centre.y, math::atan2(r[(1, 0)], r[(0, 0)])])
}

/// One row per coordinate of the platform.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    let description = shipped("prs3")?;
    let model = &description.robot.model;
    let mut data = Data::new(model);
    closed_at(model, &mut data, &SLIDERS, "position problem")?;
    let ours = pose_of_platform(model, &data)?;
    let row = |((what, checked), ours): ((&str, f64), f64)| {
        // The sliders are given with eight decimals.
        let row = Row::held_against("section 2", format!("position problem: {what}"), ours, None, (Gate::Within(2e-8), checked));
        row.because("the paper prints no lengths: those of the laboratory's recordings")
    };
    Ok(POSE.into_iter().zip(ours).map(row).collect())
}
