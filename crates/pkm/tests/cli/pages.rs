//! The pages that verbs write, opened in a browser that is not ours: nothing on its console, nothing wider than the window, pictures drawn,
//! text large enough to read, on a screen and on a telephone; and printed. Without Chromium this is not run, and says so.

use core::time::Duration;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::fixture::{demo, prints, rig_with_recordings};

/// Names under which Chromium is installed.
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

/// A browser that has not finished by then hangs `[s]`.
const PATIENCE_S: u32 = 180;

/// Text below this size cannot be read without a lens `[px]`; the dense matrix of angles has the smallest.
const TEXT_MIN_PX: f64 = 11.0;

#[expect(clippy::print_stdout, reason = "a test that could not run must say so")]
fn browser() -> Option<&'static str> {
    let is_there = |name: &&&str| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success());
    let found = BROWSERS.iter().find(is_there).copied();
    if found.is_none() {
        println!("not run: no Chromium is installed ({})", BROWSERS.join(", "));
    }
    found
}

/// Runs the browser without a window; what it wrote to standard output and to standard error.
fn browse(browser: &str, folder: &Path, arguments: &[&str], page: &str) -> [String; 2] {
    let [out, told] = ["browser.out", "browser.err"].map(|name| folder.join(name));
    let profile = format!("--user-data-dir={}", folder.join("profile").display());
    // Containers have no sandbox and little shared memory.
    let container = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"];
    let quiet = ["--headless", "--hide-scrollbars", "--allow-file-access-from-files", "--enable-logging=stderr"];
    let mut child = Command::new(browser)
        .args(quiet)
        .args(container)
        .arg(profile)
        .args(arguments)
        .arg(folder.join(page))
        .stdin(Stdio::null())
        .stdout(File::create(&out).unwrap())
        .stderr(File::create(&told).unwrap())
        .spawn()
        .unwrap();
    for _ in 0..10 * PATIENCE_S {
        if child.try_wait().unwrap().is_some() {
            return [out, told].map(|file| String::from_utf8_lossy(&fs::read(file).unwrap()).into_owned());
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    child.kill().unwrap();
    panic!("{browser} {arguments:?} {page} did not end in {PATIENCE_S} s");
}

/// What the probe measured of every page at every width, and the lines of the browser's console.
fn look(browser: &str, folder: &Path, pages: &[&str]) -> (Vec<Value>, Vec<String>) {
    let probe = include_str!("pages/probe.html").replace("PAGES", &serde_json::to_string(pages).unwrap());
    fs::write(folder.join("probe.html"), probe).unwrap();
    let [dom, told] = browse(browser, folder, &["--virtual-time-budget=60000", "--dump-dom"], "probe.html");
    let measured = dom.split_once("MEASURED").and_then(|(_, rest)| rest.split_once("END")).map(|(text, _)| text);
    let measured: Vec<Value> = serde_json::from_str(measured.unwrap_or_else(|| panic!("no measurement in {dom}\n{told}"))).unwrap();
    assert_eq!(measured.len(), 2 * pages.len());
    (measured, told.lines().filter(|l| l.contains("CONSOLE")).map(str::to_string).collect())
}

/// A folder with a page of every verb that writes one.
fn pages() -> (tempfile::TempDir, Vec<&'static str>) {
    let folder = rig_with_recordings();
    let verb = |line: &str| prints(folder.path(), &line.split_whitespace().collect::<Vec<_>>());
    fs::copy(demo().join("demo/report.html"), folder.path().join("report.html")).unwrap();
    fs::write(folder.path().join("two.toml"), include_str!("../../../../docs/examples/two_masses.toml")).unwrap();
    verb("workspace five_bar --axes shoulder_left,shoulder_right --html workspace.html --quiet");
    verb("excite rig.toml --out motion.csv --period 4 --restarts 1 --draws 4 --iterations 5 --harmonics 4 --html excite.html --quiet");
    verb("identify rig.toml --recording A.csv --holdout B.csv --html identify.html --quiet");
    verb("plan rig.toml --reference motion.csv --noise 0.1 --html plan.html --quiet");
    verb("twin rig.toml --recording A.mcap --html twin.html");
    verb("mu two.toml --html mu.html");
    verb("reproduce arceo2021 --html reproduce.html");
    let names = ["report.html", "workspace.html", "excite.html", "identify.html", "plan.html", "twin.html", "mu.html", "reproduce.html"];
    (folder, names.to_vec())
}

#[test]
fn every_page_is_well_in_a_browser_on_a_screen_and_on_a_telephone() {
    let Some(browser) = browser() else { return };
    let (folder, pages) = pages();
    let (measured, console) = look(browser, folder.path(), &pages);
    assert!(console.is_empty(), "{console:?}");
    for m in &measured {
        assert_eq!((&m["scroll"], &m["outside"]), (&m["width"], &Value::Array(vec![])), "wider than the window: {m}");
        // A plan is tables alone.
        let wanted = u64::from(m["page"] != "plan.html");
        assert!(m["pictures"].as_u64().unwrap() >= wanted && m["flat"] == 0, "pictures: {m}");
        assert!(m["smallest_text_px"].as_f64().unwrap() >= TEXT_MIN_PX, "small print: {m}");
    }
    let of = |page: &str| measured.iter().find(|m| m["page"] == page).unwrap();
    // Error bars of both models and of the finding, the finding's scatter, two plots for each of two joints in two recordings.
    assert!(of("report.html")["pictures"].as_u64().unwrap() >= 12, "{}", of("report.html"));
}

#[test]
fn what_is_wrong_with_a_page_is_seen() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let page = fs::read_to_string(demo().join("demo/report.html")).unwrap();
    let spoilt = [
        ("path.html", page.replacen(" d=\"M", " d=\"Mx", 1)),
        ("wide.html", page.replacen("<section", "<div style=\"width:1300px\">wide</div><section", 1)),
        ("flat.html", page.replace("</style>", ".area{height:2px!important}</style>")),
        ("small.html", page.replace("</style>", "p{font-size:7px!important}</style>")),
    ];
    for (name, text) in &spoilt {
        assert!(*text != page, "{name}");
        fs::write(folder.path().join(name), text).unwrap();
    }
    let (measured, console) = look(browser, folder.path(), &spoilt.each_ref().map(|s| s.0));
    assert!(console.iter().any(|l| l.contains("attribute d")), "{console:?}");
    for m in &measured {
        let page = m["page"].as_str().unwrap();
        assert_eq!(m["scroll"] != m["width"], page == "wide.html", "{m}");
        assert_eq!(m["flat"] != 0, page == "flat.html", "{m}");
        assert_eq!(m["smallest_text_px"].as_f64().unwrap() < TEXT_MIN_PX, page == "small.html", "{m}");
    }
}

#[test]
fn a_report_prints_on_pages_of_paper() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    fs::copy(demo().join("demo/report.html"), folder.path().join("report.html")).unwrap();
    let pdf: PathBuf = folder.path().join("report.pdf");
    browse(browser, folder.path(), &[&format!("--print-to-pdf={}", pdf.display()), "--no-pdf-header-footer"], "report.html");
    let bytes = fs::read(&pdf).unwrap();
    assert!(bytes.starts_with(b"%PDF-"));
    let sheets = bytes.windows(12).filter(|w| w.starts_with(b"/Type /Page") && w[11] != b's').count();
    assert!((2..=20).contains(&sheets), "{sheets} pages");
}
