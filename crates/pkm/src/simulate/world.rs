//! `--world FILE`: drives that are not ideal, sensors that err, and a limb in the robot; layout in docs/FORMATS.md.

mod equip;
mod layout;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, ensure};
use pkm_dyn::model::Model;
use pkm_sim::{ConstrainedOptions, Equipment, PlantKind};

/// Largest file read, in bytes.
const BYTES_MAX: u64 = 1 << 20;

/// Choice of world.
#[derive(Debug, clap::Args)]
pub(crate) struct WorldArgs {
    /// A world.toml: encoders, electronics, transmissions, lost samples, wrench cells, a limb. What is recorded is what the sensors say
    /// [default: encoders and efforts with white noise].
    #[arg(long, value_name = "FILE", conflicts_with = "noise", help_heading = "Sensors")]
    world: Option<PathBuf>,
}

impl WorldArgs {
    /// The file, if there is one.
    pub(crate) fn path(&self) -> Option<&Path> {
        self.world.as_deref()
    }

    /// Reads the file for `model`; `seed` is taken where it states none.
    ///
    /// # Errors
    /// A file that cannot be read, and everything in it that is refused.
    pub(crate) fn read(&self, model: &Model, seed: u64) -> anyhow::Result<Option<Equipment>> {
        let Some(path) = &self.world else { return Ok(None) };
        parse(&text_of(path)?, &path.display().to_string(), model, seed).map(Some)
    }

    /// The plant: with a world that of all effects unless flags say otherwise.
    pub(crate) fn plant(&self, kind: PlantKind, seed: u64) -> PlantKind {
        if self.world.is_some() && kind == PlantKind::Auto {
            return PlantKind::Constrained(ConstrainedOptions { seed, ..ConstrainedOptions::default() });
        }
        kind
    }
}

/// What `text`, the content of `file`, makes of a robot.
fn parse(text: &str, file: &str, model: &Model, seed: u64) -> anyhow::Result<Equipment> {
    let layout: layout::World = toml::from_str(text).map_err(|e: toml::de::Error| {
        let line = e.span().map_or(1, |s| 1 + text.bytes().take(s.start).filter(|b| *b == b'\n').count());
        anyhow!("{file}:{line}: {}", e.message().split_whitespace().collect::<Vec<_>>().join(" "))
    })?;
    equip::equipment(&layout, model, seed).with_context(|| file.to_string())
}

fn text_of(path: &Path) -> anyhow::Result<String> {
    let file = path.display();
    let mut bytes = Vec::new();
    let open = File::open(path).map_err(|e| anyhow!("{file}: {e}"))?;
    ensure!(!open.metadata().is_ok_and(|m| m.is_dir()), "{file}: is a directory");
    open.take(BYTES_MAX + 1).read_to_end(&mut bytes).map_err(|e| anyhow!("{file}: {e}"))?;
    ensure!(bytes.len() as u64 <= BYTES_MAX, "{file}: more than {BYTES_MAX} bytes (the limit)");
    String::from_utf8(bytes).map_err(|e| anyhow!("{file}: byte {} is not UTF-8", e.utf8_error().valid_up_to()))
}
