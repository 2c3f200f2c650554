//! `--plant`, `--integrator`, `--step`, `--end-stops`: what moves the simulated robot.

use clap::ValueEnum;
use pkm_sim::{ConstrainedOptions, Integrator, PlantKind};

use crate::diagnosis::positive;

/// Choice of plant.
#[derive(Debug, clap::Args)]
pub(crate) struct PlantArgs {
    /// Plant [default: reduced, or constrained where an effect has states or any flag below is given].
    #[arg(long, value_name = "PLANT", help_heading = "Plant")]
    plant: Option<PlantName>,
    /// Rule of the constrained plant between events.
    #[arg(long, value_name = "RULE", help_heading = "Plant")]
    integrator: Option<RuleName>,
    /// Longest step of the constrained plant [default: half a control period].
    #[arg(long, value_name = "S", value_parser = positive, help_heading = "Plant")]
    step: Option<f64>,
    /// Joints stop at their limits, with this share of their speed sent back, 0 to 1.
    #[arg(long, value_name = "SHARE", value_parser = share, help_heading = "Plant")]
    end_stops: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PlantName {
    /// Coordinates of the drives.
    Reduced,
    /// Coordinates of the whole tree.
    Constrained,
    /// A foreign engine, where the binary is built with it.
    Rapier,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum RuleName {
    /// Runge-Kutta, or Radau where a spring is too stiff for it.
    Auto,
    /// Order four, explicit.
    RungeKutta,
    /// Order three, damps what is too fast.
    Radau,
    /// Order four, keeps energy.
    Gauss,
    /// Order two, solves contacts in every step.
    Moreau,
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if (0.0..=1.0).contains(&x) => Ok(x),
        _ => Err("must be a number from 0 to 1".to_string()),
    }
}

impl PlantArgs {
    /// The plant that the flags ask for; `seed` is that of persons.
    pub(crate) fn kind(&self, seed: u64) -> anyhow::Result<PlantKind> {
        let is_detailed = self.integrator.is_some() || self.step.is_some() || self.end_stops.is_some();
        anyhow::ensure!(
            !(is_detailed && matches!(self.plant, Some(PlantName::Reduced | PlantName::Rapier))),
            "--integrator, --step and --end-stops are of the constrained plant (--plant constrained)"
        );
        let integrator = match self.integrator {
            None | Some(RuleName::Auto) => Integrator::Auto,
            Some(RuleName::RungeKutta) => Integrator::RungeKutta,
            Some(RuleName::Radau) => Integrator::Radau,
            Some(RuleName::Gauss) => Integrator::Gauss,
            Some(RuleName::Moreau) => Integrator::Moreau,
        };
        let constrained = PlantKind::Constrained(ConstrainedOptions { integrator, step_s: self.step, end_stops: self.end_stops, seed });
        Ok(match self.plant {
            Some(PlantName::Reduced) => PlantKind::Reduced,
            Some(PlantName::Constrained) => constrained,
            #[cfg(feature = "rapier")]
            Some(PlantName::Rapier) => PlantKind::Rapier(pkm_sim::RapierOptions::default()),
            #[cfg(not(feature = "rapier"))]
            Some(PlantName::Rapier) => anyhow::bail!("--plant rapier: this pkm is built without it (feature \"rapier\" of crate pkm)"),
            None if is_detailed => constrained,
            None => PlantKind::Auto,
        })
    }
}
