//! The guide in docs/guide: a page for every effect and none besides, true to the catalogue; every link leads somewhere.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails, outside #[test] functions too")]

extern crate alloc;

use alloc::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use pkm_dyn::effects::{CATALOGUE, Entry};

/// Sections that a person writes, on every page of an effect.
const WRITTEN: [&str; 3] = ["## What it looks like", "## How to tell it from others", "## What to do about it"];

/// Largest picture of an effect `[B]`.
const PICTURE_MAX: usize = 16_000;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

fn source() -> PathBuf {
    root().join("docs/guide/src")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Every page below a folder.
fn pages(folder: &Path) -> Vec<PathBuf> {
    let mut out = Vec::new();
    for path in fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
        if path.is_dir() {
            out.extend(pages(&path));
        } else if path.extension().is_some_and(|e| e == "md") {
            out.push(path);
        }
    }
    out.sort();
    out
}

/// Targets of the links and pictures of a page that are files, and of what it includes; code is passed over.
fn targets(page: &str) -> Vec<String> {
    let mut out = Vec::new();
    let mut is_code = false;
    for line in page.lines() {
        if line.trim_start().starts_with("```") {
            is_code = !is_code;
        }
        if is_code {
            continue;
        }
        let links = line.split("](").skip(1).filter_map(|rest| rest.split(')').next());
        let included = line.strip_prefix("{{#include ").and_then(|rest| rest.strip_suffix("}}"));
        out.extend(links.chain(included).map(|t| t.split('#').next().unwrap_or_default().to_string()));
    }
    out.retain(|t| !t.is_empty() && !t.contains("://"));
    out
}

fn section<'a>(page: &'a str, heading: &str) -> &'a str {
    let (_, rest) = page.split_once(&format!("\n{heading}\n")).unwrap_or_else(|| panic!("no {heading:?}"));
    rest.split("\n## ").next().unwrap().split("<!--").next().unwrap().trim()
}

#[test]
fn every_effect_has_a_page_and_every_page_an_effect() {
    let named: BTreeSet<String> = CATALOGUE.iter().map(|e| format!("{}.md", e.name)).chain(["index.md".to_string()]).collect();
    let there: BTreeSet<String> =
        pages(&source().join("effects")).iter().map(|p| p.file_name().unwrap().to_string_lossy().into_owned()).collect();
    assert_eq!(there, named);
    let summary = read(&source().join("SUMMARY.md"));
    let overview = read(&source().join("effects/index.md"));
    for e in CATALOGUE {
        assert!(summary.contains(&format!("[{0}](effects/{0}.md)", e.name)), "SUMMARY.md lacks {}", e.name);
        assert!(overview.contains(&format!("({0}.md) `{0}`", e.name)), "the overview lacks {}", e.name);
    }
}

/// What the catalogue says of an effect, with which its page must agree.
fn facts(e: &Entry) -> Vec<&'static str> {
    let alike = e.look_alikes.iter().flat_map(|l| [l.effect, l.experiment]);
    [e.name, e.sentence, e.equation, e.compensation].into_iter().chain(alike).chain(e.parameters.iter().map(|p| p.name)).collect()
}

#[test]
fn a_page_has_what_a_person_wrote_and_what_the_catalogue_says_today() {
    for e in CATALOGUE {
        let page = read(&source().join(format!("effects/{}.md", e.name)));
        assert!(page.starts_with("# ") && page.lines().next().unwrap().ends_with(&format!(": `{}`", e.name)), "{}", e.name);
        let physics = page.split("\n## ").next().unwrap();
        assert!(physics.len() > 150, "{}: the physics in {} letters", e.name, physics.len());
        for heading in WRITTEN {
            assert!(section(&page, heading).len() > 25, "{}: {heading} is empty", e.name);
        }
        for fact in facts(e) {
            assert!(page.contains(fact), "{} lacks {fact:?}: `cargo xtask atlas {0}`", e.name);
        }
        let mark = page.lines().find(|l| l.starts_with("<!-- cargo xtask atlas: ")).unwrap_or_else(|| panic!("{}: no mark", e.name));
        let concealed = mark.trim_end_matches(" -->").rsplit(' ').next().unwrap();
        assert!(concealed.starts_with(&format!("{}@", e.name)), "{}: the mark conceals {concealed}", e.name);
        // The page was written after its mark: both recordings of its commands conceal what the mark says.
        assert_eq!(page.matches(&format!("--hide '{concealed}'")).count(), 2, "{}: `cargo xtask atlas {0}`", e.name);
        let picture = read(&source().join(format!("effects/pictures/{}.svg", e.name)));
        assert!(picture.len() < PICTURE_MAX && picture.starts_with("<svg") && picture.contains("added effort"), "{}", e.name);
        assert!(!picture.contains("NaN") && picture.matches("<g ").count() == picture.matches("</g>").count(), "{}", e.name);
    }
}

#[test]
fn every_link_of_the_guide_leads_to_a_file_and_every_page_is_in_the_summary() {
    let summary = targets(&read(&source().join("SUMMARY.md")));
    let listed: BTreeSet<PathBuf> = summary.iter().map(|t| source().join(t)).collect();
    assert_eq!(summary.len(), listed.len(), "a page is in the summary twice");
    let there: BTreeSet<PathBuf> = pages(&source()).into_iter().filter(|p| p.file_name().unwrap() != "SUMMARY.md").collect();
    assert_eq!(there, listed);
    for page in pages(&source()) {
        for target in targets(&read(&page)) {
            let file = page.with_file_name(&target);
            assert!(file.is_file(), "{}: {target} leads nowhere", page.display());
        }
    }
}

#[test]
fn every_link_of_the_repository_s_own_pages_leads_to_a_file() {
    let own = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "python/README.md", "benches/README.md"].map(|n| root().join(n));
    for page in own.into_iter().chain(pages(&root().join("docs")).into_iter().filter(|p| !p.starts_with(source()))) {
        for target in targets(&read(&page)) {
            assert!(page.with_file_name(&target).exists(), "{}: {target} leads nowhere", page.display());
        }
    }
}

#[test]
fn links_in_code_and_to_the_network_are_passed_over() {
    let page = "[a](b.md#c) ![p](q.svg)\n```\n[x](y)\n```\n[n](https://z)\n[h](#i)\n{{#include ../r.md}}\n";
    assert_eq!(targets(page), ["b.md", "q.svg", "../r.md"]);
}
