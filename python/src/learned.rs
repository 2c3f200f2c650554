//! What an identification has learned, as plain numbers and texts: it travels as bytes.

use pkm_dyn::urdf::Description;
use pkm_ident::answer::{self, Estimated};
use pkm_ident::beside::Beside;
use pkm_ident::note::{Note, Status};
use pkm_ident::refine::identified;
use serde::{Deserialize, Serialize};

/// A number with its 95 % interval.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Number {
    pub(crate) name: String,
    pub(crate) unit: String,
    pub(crate) value: f64,
    pub(crate) ci95: [f64; 2],
}

/// A shape of a friction law.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Shape {
    pub(crate) number: Number,
    pub(crate) stated: f64,
    pub(crate) is_shown: bool,
}

/// The gain of a drive.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Gain {
    pub(crate) joint: String,
    pub(crate) gain: f64,
    pub(crate) ci95: [f64; 2],
    pub(crate) load_share: f64,
}

/// The gains of all drives.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Gains {
    pub(crate) status: String,
    pub(crate) notes: Vec<String>,
    pub(crate) drives: Vec<Gain>,
}

/// What rides on a link.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Payload {
    pub(crate) link: String,
    pub(crate) status: String,
    pub(crate) notes: Vec<String>,
    pub(crate) body: Vec<f64>,
    pub(crate) shown: Vec<Number>,
}

/// Everything behind the learned names, SI.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Learned {
    pub(crate) status: String,
    pub(crate) notes: Vec<String>,
    pub(crate) names: Vec<String>,
    pub(crate) theta: Vec<f64>,
    pub(crate) names_base: Vec<String>,
    pub(crate) theta_base: Vec<f64>,
    /// Row by row.
    pub(crate) covariance: Vec<f64>,
    pub(crate) ci95: Vec<[f64; 2]>,
    pub(crate) intervals: String,
    pub(crate) shapes: Vec<Shape>,
    pub(crate) preprocessing: Vec<String>,
    pub(crate) gains: Option<Gains>,
    pub(crate) payload: Option<Payload>,
    /// By drive: nominal, identified.
    pub(crate) heldout: Vec<(String, [f64; 2])>,
    /// The same of all drives.
    pub(crate) pooled: [f64; 2],
    /// The identified robot: texts of its robot.toml and of its URDF.
    pub(crate) robot: [String; 2],
}

fn status(status: Status) -> String {
    let word = match status {
        Status::Identified => "identified",
        Status::Doubtful => "doubtful",
        Status::NotIdentified => "not_identified",
    };
    word.to_string()
}

fn sentences(notes: &[Note]) -> Vec<String> {
    notes.iter().map(ToString::to_string).collect()
}

fn number(e: &Estimated) -> Number {
    Number { name: e.name.clone(), unit: e.unit.to_string(), value: e.value, ci95: e.ci95 }
}

impl Learned {
    /// From the answers of the crate; the reason where the identified robot cannot be written.
    pub(crate) fn of(description: &Description, found: &answer::Identification, beside: &Beside) -> Result<Self, String> {
        let c = &found.covariance;
        let gains = beside.gains.as_ref().map(|g| Gains {
            status: status(g.status),
            notes: sentences(&g.notes),
            drives: g.gains.iter().map(|g| Gain { joint: g.joint.clone(), gain: g.gain, ci95: g.ci95, load_share: g.load_share }).collect(),
        });
        let payload = beside.payload.as_ref().map(|p| Payload {
            link: p.link.clone(),
            status: status(p.status),
            notes: sentences(&p.notes),
            body: p.body.to_vector().iter().copied().collect(),
            shown: p.shown.iter().map(number).collect(),
        });
        let shapes = found.shapes.iter().map(|s| Shape {
            number: Number { name: s.name.clone(), unit: s.unit.to_string(), value: s.value, ci95: s.ci95 },
            stated: s.stated,
            is_shown: s.is_shown,
        });
        Ok(Self {
            status: status(found.status),
            notes: sentences(&found.notes),
            names: found.columns.list.iter().map(|p| p.name.clone()).collect(),
            theta: found.theta.clone(),
            names_base: found.parameters.iter().map(|p| p.name.clone()).collect(),
            theta_base: found.parameters.iter().map(|p| p.value).collect(),
            covariance: (0..c.nrows()).flat_map(|i| (0..c.ncols()).map(move |j| c[(i, j)])).collect(),
            ci95: found.parameters.iter().map(|p| p.ci95).collect(),
            intervals: found.intervals.says().to_string(),
            shapes: shapes.collect(),
            preprocessing: found.preprocessing.iter().map(ToString::to_string).collect(),
            gains,
            payload,
            heldout: found.joints.iter().map(|j| (j.joint.clone(), [j.nominal, j.identified])).collect(),
            pooled: [found.pooled(|j| j.nominal), found.pooled(|j| j.identified)],
            robot: identified(description, found).texts(description, "identified.urdf")?,
        })
    }
}
