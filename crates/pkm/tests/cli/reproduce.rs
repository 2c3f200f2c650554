//! `pkm reproduce`: every paper's rows meet their gates, as text, JSON and page.

use std::fs;

use crate::fixture::{prints, refused};

const PAPERS: [&str; 4] = ["valera2017", "armas", "arceo2021", "mcdaid"];

#[test]
fn every_paper_has_rows_and_none_is_missed() {
    for paper in PAPERS {
        let folder = tempfile::tempdir().unwrap();
        let text = prints(folder.path(), &["reproduce", paper, "--json", "--html", "page.html"]);
        let found: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!((&found["schema"], &found["paper"]), (&"pkm.reproduction/1".into(), &paper.into()));
        let rows = found["rows"].as_array().unwrap();
        assert!(!rows.is_empty() && found["is_sound"] == true, "{text}");
        let page = fs::read_to_string(folder.path().join("page.html")).unwrap();
        for row in rows {
            assert!(row["verdict"] != "missed" && row["ours"].is_number() && !row["place"].as_str().unwrap().is_empty(), "{row}");
            assert!(row["paper"].is_number() || row["paper"].is_null());
            let what = row["what"]
                .as_str()
                .unwrap()
                .replace('&', "&amp;")
                .replace('<', "&lt;")
                .replace('>', "&gt;")
                .replace('"', "&quot;")
                .replace('\'', "&#39;");
            assert!(page.contains(&what), "the page lacks {what:?}");
        }
    }
}

#[test]
fn the_table_names_equation_numbers_and_verdict() {
    let folder = tempfile::tempdir().unwrap();
    let text = prints(folder.path(), &["reproduce", "arceo2021"]);
    for part in ["held against", "Table 2", "8.42", "8.416", "reproduced", "Notes", "projected inertia"] {
        assert!(text.contains(part), "{text} lacks {part:?}");
    }
}

#[test]
fn an_unknown_paper_is_refused_with_those_there_are() {
    let folder = tempfile::tempdir().unwrap();
    refused(folder.path(), &["reproduce", "newton1687"], &["newton1687", "valera2017, armas, arceo2021, mcdaid"]);
}
