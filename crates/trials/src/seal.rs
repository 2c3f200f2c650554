//! Sealed answers: hashes that are told before any diagnosis starts.

use alloc::collections::BTreeMap;

use sha2::{Digest, Sha256};

/// SHA-256 of a text or of bytes, in hexadecimal.
#[must_use]
pub fn sha256(of: impl AsRef<[u8]>) -> String {
    Sha256::digest(of.as_ref()).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Hashes of answers by the name of their case, as the text of a file of seals: one `hash  name` per line, as `sha256sum` writes them.
#[must_use]
pub fn list(seals: &BTreeMap<String, String>) -> String {
    seals.iter().map(|(name, hash)| format!("{hash}  {name}.json\n")).collect()
}

/// Reads what [`list`] writes.
///
/// # Errors
/// The first line that is none.
pub fn read_list(text: &str) -> Result<BTreeMap<String, String>, String> {
    let mut out = BTreeMap::new();
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        let parts = line.split_once("  ").and_then(|(hash, name)| Some((hash, name.strip_suffix(".json")?)));
        let Some((hash, name)) = parts.filter(|(hash, _)| hash.len() == 64 && hash.bytes().all(|b| b.is_ascii_hexdigit())) else {
            return Err(format!("line {}: not a seal: 64 hexadecimal digits, two spaces, NAME.json", i + 1));
        };
        out.insert(name.to_string(), hash.to_string());
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_the_published_one() {
        // FIPS 180-2, appendix B.1.
        assert_eq!(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }

    #[test]
    fn lists_come_back_and_others_are_refused() {
        let seals: BTreeMap<String, String> = [("0001".to_string(), sha256("a")), ("0002".to_string(), sha256("b"))].into();
        assert_eq!(read_list(&list(&seals)), Ok(seals));
        assert!(read_list("abc  0001.json").is_err() && read_list(&format!("{}  0001", sha256("a"))).is_err());
    }
}
