//! What a file says of contact: the wrench sensor, limits of what it measures, how long a law of contact runs.

use super::{ConfigError, Reader};

/// Longest run of a law of contact or an exercise `[s]`.
const LONGEST_RUN_S: f64 = 86_400.0;

impl Reader<'_> {
    /// Largest force and moment of the environment; what nobody measures cannot be limited.
    pub(super) fn contact(&self) -> Result<[f64; 2], ConfigError> {
        let (l, is_measured) = (&self.config.layout.limits, self.config.layout.hal.wrench.is_some());
        let one = |key: &str, stated: Option<&toml::Spanned<f64>>, unit: &str| {
            if let Some(stated) = stated.filter(|_| !is_measured) {
                let problem = format!("{key} = {}: no wrench is measured (hal.wrench names the sensor)", stated.get_ref());
                return Err(self.config.error(stated.span().start, problem));
            }
            self.number(key, stated, f64::INFINITY, [f64::MIN_POSITIVE, f64::INFINITY], unit)
        };
        Ok([one("limits.force", l.force.as_ref(), "N")?, one("limits.moment", l.moment.as_ref(), "N·m")?])
    }

    /// How long what leads itself runs; a motion has a length of its own, and a position loop goes nowhere by itself.
    pub(super) fn length_s(&self) -> Result<Option<f64>, ConfigError> {
        let run = &self.config.layout.run;
        let Some(stated) = &run.length_s else { return Ok(None) };
        let bad = |problem: &str| Err(self.config.error(stated.span().start, format!("run.length_s = {}: {problem}", stated.get_ref())));
        if run.motion.is_some() {
            return bad("run.motion has a length of its own");
        }
        if run.controller.is_none() {
            return bad("nothing runs (run.controller names a law of contact or an exercise)");
        }
        self.number("run.length_s", Some(stated), 0.0, [1e-3, LONGEST_RUN_S], "s").map(Some)
    }

    /// Number of the model's sensor that measures the wrench.
    pub(super) fn wrench(&self) -> Result<Option<usize>, ConfigError> {
        let Some(stated) = &self.config.layout.hal.wrench else { return Ok(None) };
        let found = self.model.sensors.iter().position(|sensor| sensor.name == *stated.get_ref());
        let names: Vec<&str> = self.model.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
        let problem = format!("hal.wrench: the robot has no sensor {:?} (there are: {})", stated.get_ref(), names.join(", "));
        found.map(Some).ok_or_else(|| self.config.error(stated.span().start, problem))
    }
}
