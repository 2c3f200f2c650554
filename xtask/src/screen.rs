//! A picture of parts of a page that pkm wrote, taken with Chromium.

use core::time::Duration;
use std::fs::{self, File};
use std::path::Path;
use std::process::{Command, Stdio};

use crate::shell::answer;

/// Names under which Chromium is installed.
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

/// A browser that has not finished by then hangs `[s]`.
const PATIENCE_S: u32 = 60;

/// Largest picture `[B]`: the guide is read over networks.
pub(crate) const LARGEST: u64 = 150_000;

/// What stands above the sections of a page, as a part to be shown.
const TOP: &str = "top";

/// The start of a section, as pages of pkm have it.
const SECTION: &str = "<section";

/// Leaves out what is hidden and what leads elsewhere, and sets what is left close together.
const STYLE: &str = "<style>[hidden],nav,footer{display:none!important}section{margin:0!important}\
                     main{display:flex;flex-direction:column;gap:24px;padding:20px 24px!important}</style>";

/// Leaves out what is above the sections.
const TOPLESS: &str = "<style>main>:not(section){display:none!important}</style>";

/// Says how high the page is, for a browser that prints what it made of it.
const MEASURE: &str = "<script>document.documentElement.dataset.height=Math.ceil(document.body.getBoundingClientRect().height)</script>";

/// Takes a picture of the parts of a page (headings of sections, or their beginnings) in a window `width` pixels wide, cut off
/// below `highest` pixels; `false` where there is no browser.
pub(crate) fn shoot(page: &Path, parts: &[&str], (width, highest): (u32, u32), picture: &Path) -> Result<bool, String> {
    let Some(browser) = BROWSERS.iter().find(|name| answer(Command::new(name).arg("--version")).is_some()) else { return Ok(false) };
    let failed = |e: std::io::Error| format!("{}: {e}", page.display());
    let text = fs::read_to_string(page).map_err(failed)?;
    let shown = page.with_extension("part.html");
    fs::write(&shown, with_parts(&text, parts).map_err(|e| format!("{}: {e}", page.display()))?).map_err(failed)?;
    let measured = browse(browser, &shown, &["--dump-dom", &format!("--window-size={width},200")])?;
    let height = height(&measured).ok_or_else(|| format!("{}: {browser} does not say how high it is", shown.display()))?;
    let size = format!("--window-size={width},{}", height.min(highest));
    browse(browser, &shown, &[&format!("--screenshot={}", picture.display()), &size])?;
    let bytes = fs::metadata(picture).map_err(|e| format!("{}: {e}", picture.display()))?.len();
    let name = picture.file_name().unwrap_or_default().to_string_lossy();
    println!("      {name}: {} of {height} pixels high, {} kB", height.min(highest), bytes / 1000);
    if bytes > LARGEST {
        return Err(format!("{}: {bytes} bytes (at most {LARGEST}): show fewer parts, or cut it off higher", picture.display()));
    }
    Ok(true)
}

/// The page without the sections that are not among the parts.
fn with_parts(page: &str, parts: &[&str]) -> Result<String, String> {
    let mut missing: Vec<&str> = parts.iter().copied().filter(|p| *p != TOP).collect();
    let mut pieces = page.split(SECTION);
    let mut out = pieces.next().unwrap_or_default().to_string();
    for piece in pieces {
        let title = piece.split_once("<h2>").and_then(|(_, rest)| rest.split("</h2>").next()).unwrap_or_default();
        let is_part = parts.iter().any(|part| title.starts_with(part));
        missing.retain(|part| !title.starts_with(part));
        out += SECTION;
        out += if is_part { "" } else { " hidden" };
        out += piece;
    }
    if let Some(part) = missing.first() {
        return Err(format!("no section {part:?}"));
    }
    let topless = if parts.contains(&TOP) { "" } else { TOPLESS };
    Ok(out.replacen("</head>", &format!("{STYLE}{topless}</head>"), 1).replacen("</body>", &format!("{MEASURE}</body>"), 1))
}

/// The height that a page told of itself `[px]`.
fn height(dom: &str) -> Option<u32> {
    dom.split_once("data-height=\"")?.1.split('"').next()?.parse().ok()
}

/// Runs the browser without a window; what it prints.
fn browse(browser: &str, page: &Path, arguments: &[&str]) -> Result<String, String> {
    let failed = |e: std::io::Error| format!("{browser}: {e}");
    let out = page.with_extension("out");
    let mut command = Command::new(browser);
    command.args(["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]).args(arguments);
    command.arg(format!("--user-data-dir={}", page.with_file_name("browser").display())).arg(page);
    let mut child =
        command.stdin(Stdio::null()).stdout(File::create(&out).map_err(failed)?).stderr(Stdio::null()).spawn().map_err(failed)?;
    for _ in 0..10 * PATIENCE_S {
        if let Some(status) = child.try_wait().map_err(failed)? {
            let text = fs::read(&out).map_err(failed)?;
            return if status.success() { Ok(String::from_utf8_lossy(&text).into_owned()) } else { Err(format!("{browser}: {status}")) };
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    child.kill().map_err(failed)?;
    Err(format!("{browser} did not end in {PATIENCE_S} s"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str =
        "<head></head><body><header>h</header><section id=\"a\"><h2>One, two</h2></section><section><h2>Three</h2></section></body>";

    #[test]
    fn sections_that_are_not_asked_for_are_hidden() {
        let page = with_parts(PAGE, &["Three"]).unwrap();
        assert!(page.contains(TOPLESS) && page.contains("<section hidden id=\"a\">") && page.contains("<section><h2>Three"));
        let page = with_parts(PAGE, &[TOP, "One"]).unwrap();
        assert!(!page.contains(TOPLESS) && page.contains("<section id=\"a\">") && page.contains("<section hidden><h2>Three"));
        assert_eq!(with_parts(PAGE, &["Four"]), Err("no section \"Four\"".to_string()));
    }

    #[test]
    fn a_page_tells_its_height() {
        assert_eq!(height("<html lang=\"en\" data-height=\"712\"><head>"), Some(712));
        assert_eq!(height("<html>"), None);
    }
}
