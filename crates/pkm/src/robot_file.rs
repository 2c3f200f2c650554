//! The robot that a command names: a robot.toml, or a shipped robot by name.

use std::path::Path;

use anyhow::bail;
use pkm_dyn::urdf::{Description, load, parse};

/// Reads the robot.toml at `robot`; a bare word that is no file is the name of a shipped robot.
///
/// # Errors
/// One line that names file, place, value and limit.
pub(crate) fn read(robot: &Path) -> anyhow::Result<Description> {
    if !robot.is_file()
        && let Some(name) = bare_word(robot)
    {
        if let Some(shipped) = pkm_robots::find(name) {
            tracing::info!("shipped robot {name}");
            return Ok(parse(shipped.toml, shipped.urdf, [shipped.toml_name, shipped.urdf_name])?);
        }
        if !robot.exists() {
            let known: Vec<&str> = pkm_robots::ALL.iter().map(|r| r.name).collect();
            bail!("{name}: no such file, and no shipped robot of that name (there are: {})", known.join(", "));
        }
    }
    if robot.is_dir() {
        let inside = robot.join("robot.toml");
        let next = if inside.is_file() { format!("its robot is {}", inside.display()) } else { "there is no robot.toml in it".to_string() };
        bail!("{}: a folder (must be a robot.toml; {next})", robot.display());
    }
    if robot.extension().is_some_and(|e| e.eq_ignore_ascii_case("urdf") || e.eq_ignore_ascii_case("xacro")) {
        bail!("{}: a URDF alone is no robot (must be a robot.toml that names it and its drives: `pkm check --help`)", robot.display());
    }
    tracing::info!("robot {}", robot.display());
    Ok(load(robot)?)
}

fn bare_word(path: &Path) -> Option<&str> {
    path.to_str().filter(|text| !text.contains(['/', '\\', '.']))
}
