//! Controllers and observers in closed loops: the checks of the papers, closed forms, and what holds for every controller.

#[path = "controllers/arceo2021.rs"]
mod arceo2021;
#[path = "controllers/every.rs"]
mod every;
#[path = "controllers/gaps.rs"]
mod gaps;
#[path = "controllers/linear_adrc.rs"]
mod linear_adrc;
#[path = "controllers/model_based.rs"]
mod model_based;
#[path = "controllers/momentum.rs"]
mod momentum;
#[path = "controllers/valera2017.rs"]
mod valera2017;

use serde::Deserialize;

/// Numbers made by `golden/scipy/make_controllers.py`.
#[derive(Deserialize)]
struct Golden {
    dt: f64,
    gait: Vec<f64>,
    isokinetic: Vec<f64>,
    ladrc: Vec<Step>,
}

/// Response of a loop to a step of its reference.
#[derive(Deserialize)]
struct Step {
    bandwidth: f64,
    observer: f64,
    b0: f64,
    b: f64,
    dt: f64,
    y: Vec<f64>,
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("golden/scipy/controllers.json")).expect("golden file")
}
