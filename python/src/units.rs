//! Units of the signals of a recording, by their names (docs/FORMATS.md, section 2).

use pkm_dyn::Model;
use pkm_dyn::model::JointKind;

/// Unit of a signal; none where its name says nothing.
pub(crate) fn of(model: &Model, signal: &str) -> Option<&'static str> {
    if signal == "t" {
        return Some("s");
    }
    let (kind, place) = signal.split_once('.')?;
    let component = place.rsplit('.').next().unwrap_or(place);
    match kind {
        "wrench" => match component {
            "fx" | "fy" | "fz" => Some("N"),
            "mx" | "my" | "mz" => Some("N·m"),
            _ => None,
        },
        "pose" => match component {
            "x" | "y" | "z" => Some("m"),
            "qx" | "qy" | "qz" | "qw" => Some("1"),
            _ => None,
        },
        "temp" => Some("°C"),
        _ => {
            let is_slide = model.joints[model.joint_index(place)?].kind == JointKind::Prismatic;
            let [slide, turn] = match kind {
                "q" | "q_ref" | "q_link" => ["m", "rad"],
                "dq" | "dq_ref" => ["m/s", "rad/s"],
                "ddq_ref" => ["m/s²", "rad/s²"],
                "tau" => ["N", "N·m"],
                _ => return None,
            };
            Some(if is_slide { slide } else { turn })
        }
    }
}
