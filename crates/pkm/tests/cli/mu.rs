//! `pkm mu`: a benchmark with a known margin, a matrix, a gain, and files that are none.

use std::fs;
use std::path::Path;

use crate::fixture::{prints, refused};

const TWO_MASSES: &str = include_str!("../../../../docs/examples/two_masses.toml");

fn with(name: &str, text: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join(name), text).unwrap();
    folder
}

fn json(folder: &Path, arguments: &[&str]) -> serde_json::Value {
    serde_json::from_str(&prints(folder, arguments)).unwrap()
}

#[test]
fn two_masses_have_their_margin_on_all_frequencies() {
    let folder = with("two.toml", TWO_MASSES);
    let text = prints(folder.path(), &["mu", "two.toml", "--html", "mu.html"]);
    for part in ["Robust: ", "guaranteed on [0, inf] rad/s", "2.88636", "575.034 rad/s", "0.422728 kg (stated 0.8 to 1.2)"] {
        assert!(text.contains(part), "{text} lacks {part:?}");
    }
    let page = fs::read_to_string(folder.path().join("mu.html")).unwrap();
    for part in ["<svg", "level proved on [0, inf] rad/s", "robust", "0.422728 kg"] {
        assert!(page.contains(part), "the page lacks {part:?}");
    }
    let found = json(folder.path(), &["mu", "two.toml", "--json", "--proof"]);
    assert_eq!((&found["schema"], &found["guarantee"]["kind"]), (&"pkm.mu/1".into(), &"interval".into()));
    assert!((1.0 / found["lower"].as_f64().unwrap() - 2.886_359_369).abs() < 1e-8);
    assert!((found["worst"]["blocks"][2]["value"].as_f64().unwrap() - 1.577_272).abs() < 1e-6);
    let proof = found["proof"].as_array().unwrap();
    let upper = found["upper"].as_f64().unwrap();
    assert!(!proof.is_empty() && proof.iter().all(|p| p["beta"].as_f64().unwrap() <= upper && p["G"]["re"].is_array()));
}

#[test]
fn a_matrix_from_json_and_a_gain_from_a_discrete_system() {
    let folder = with("m.json", r#"{"M": {"re": [[2, 2], [-1, -1]]}, "block": [{"kind": "complex"}, {"kind": "complex"}]}"#);
    let found = json(folder.path(), &["mu", "m.json", "--json"]);
    assert!((found["upper"].as_f64().unwrap() - 3.0).abs() < 1e-6 && found["worst"]["w"].is_null());
    assert!(prints(folder.path(), &["mu", "m.json"]).contains("Not robust"));
    // x+ = (0.5 + 0.2 δ) x + d, error x: the largest gain is 1/(1 - 0.7), at standstill.
    let text = "dt = 0.1\nA = [[0.5]]\nB = [[0.2, 1.0]]\nC = [[1.0], [1.0]]\nD = [[0.0, 0.0], [0.0, 0.0]]\n\
                [[block]]\nkind = \"real\"\n[performance]\ninputs = 1\noutputs = 1\n";
    fs::write(folder.path().join("g.toml"), text).unwrap();
    let gain = &json(folder.path(), &["mu", "g.toml", "--json"])["gain"];
    assert!((gain["upper"].as_f64().unwrap() * 0.3 - 1.0).abs() < 4e-3 && gain["is_guaranteed"] == true, "{gain}");
    assert!((gain["lower"].as_f64().unwrap() * 0.3 - 1.0).abs() < 4e-3, "{gain}");
}

#[test]
fn files_that_are_none_are_refused_in_one_line() {
    let change = |from: &str, to: &str| TWO_MASSES.replacen(from, to, 1);
    for (text, parts) in [
        (change("kind = \"real\"", "kind = \"reel\""), vec!["bad.toml: block 1 (\"m1\"): kind \"reel\"", "must be"]),
        (change("lower = 0.8", "lower = 1.8"), vec!["block 1 (\"m1\"): 1.8 to 1.2", "lower < upper"]),
        (change("lower = 0.8\n", ""), vec!["block 1 (\"m1\"): lower and upper belong together"]),
        (change("unit = \"kg\"", "units = \"kg\""), vec!["bad.toml: line ", "unknown field `units`"]),
        (change("unit = \"kg\"", "repeats = 17"), vec!["repeats 17 (must be 1 to 16)"]),
        (change("kind = \"real\"\nname = \"k\"", "kind = \"full\"\nrows = 2\nname = \"k\""), vec!["lower and upper are for kind"]),
        (change("  [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],", "  [0.0, 1.0],"), vec!["A: row 2 has 7 entries, row 1 has 2"]),
        (change("-99999999999.0", "nan"), vec!["A: entry (2, 3) is NaN (must be finite)"]),
        (change("name = \"two masses\"", "dt = -1.0"), vec!["sample time: -1 s (must be finite and > 0)"]),
        (format!("{TWO_MASSES}\n[frequency]\nlower = 5.0\nupper = 1.0\n"), vec!["frequency: 5 to 1 rad/s"]),
        (format!("{TWO_MASSES}\n[[block]]\nkind = \"real\"\n"), vec!["D: 3 x 3", "ask for 4 x 4"]),
        (format!("{TWO_MASSES}\n[performance]\ninputs = 0\noutputs = 1\n"), vec!["performance: 0 inputs (must be 1 to 64)"]),
        ("M = { re = [[1.0]] }\n".to_string(), vec!["no block"]),
        ("M = { re = [[1.0]], im = [[1.0, 2.0]] }\n[[block]]\nkind = \"real\"\n".to_string(), vec!["re is 1 x 1, im is 1 x 2"]),
        ("A = [[0.0]]\n[[block]]\nkind = \"real\"\n".to_string(), vec!["no B, C, D"]),
        (
            "A = [[0.0]]\nB = [[1.0]]\nC = [[1.0]]\nD = [[0.0]]\n[[block]]\nkind = \"real\"\n".to_string(),
            vec!["bad.toml: ", "pole at 0 rad/s"],
        ),
        ("A = [[".to_string(), vec!["bad.toml: line 1"]),
    ] {
        let folder = with("bad.toml", &text);
        refused(folder.path(), &["mu", "bad.toml", "--html", "out.html"], &parts);
    }
    let folder = with("bad.json", "{\"M\": 3}");
    refused(folder.path(), &["mu", "bad.json"], &["bad.json: ", "line 1"]);
    refused(folder.path(), &["mu", "none.toml"], &["none.toml"]);
    refused(folder.path(), &["mu", "bad.json", "--slack", "0"], &["--slack", "1e-9 to 1"]);
}
