//! A sealed answer: its hash is told before the question is asked, so that nobody can change it afterwards.

use anyhow::{Context, ensure};
use pkm_dyn::effects::Applied;
use pkm_dyn::model::Model;
use serde_json::json;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// SHA-256 of a text, in hexadecimal.
pub(crate) fn sha256(text: &str) -> String {
    Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A written answer and the hash that was told.
#[derive(Debug)]
pub(crate) struct Seal {
    path: PathBuf,
    /// SHA-256 of the file.
    pub(crate) hash: String,
}

impl Seal {
    /// Writes what was concealed to `path`. The salt keeps the hash from being found by trying out every effect.
    ///
    /// # Errors
    /// When the file system refuses.
    pub(crate) fn write(path: &Path, model: &Model, concealed: &[Applied], seed: u64) -> anyhow::Result<Self> {
        let effect = |e: &Applied| {
            let parameters: serde_json::Map<String, serde_json::Value> =
                e.entry.parameters.iter().zip(&e.values).map(|(p, v)| (p.name.to_string(), json!(v))).collect();
            json!({"effect": e.entry.name, "where": e.place_names(model), "parameters": parameters})
        };
        let answer = json!({
            "schema": "pkm.sealed/1",
            "robot": model.name,
            "seed": seed,
            "salt": sha256(&format!("salt of the sealed answer {seed}")),
            "concealed": concealed.iter().map(effect).collect::<Vec<_>>(),
            "says": pkm_sim::describe(concealed, model),
        });
        let text = serde_json::to_string_pretty(&answer)? + "\n";
        std::fs::write(path, &text).with_context(|| path.display().to_string())?;
        Ok(Self { path: path.to_path_buf(), hash: sha256(&text) })
    }

    /// Reads the answer back and checks that it is the one that was sealed.
    ///
    /// # Errors
    /// When the file is gone or changed.
    pub(crate) fn verify(&self) -> anyhow::Result<()> {
        let name = self.path.display();
        let text = std::fs::read_to_string(&self.path).with_context(|| name.to_string())?;
        ensure!(sha256(&text) == self.hash, "{name}: was changed after it had been sealed");
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_answer_breaks_the_seal() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sealed.json");
        let robot = pkm_robots::find("five_bar").unwrap();
        let description = pkm_dyn::urdf::parse(robot.toml, robot.urdf, ["a", "b"]).unwrap();
        let seal = Seal::write(&path, &description.bare, &[], 1).unwrap();
        seal.verify().unwrap();
        std::fs::write(&path, "{}").unwrap();
        assert!(seal.verify().is_err());
    }

    #[test]
    fn the_hash_is_the_published_one() {
        assert_eq!(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
