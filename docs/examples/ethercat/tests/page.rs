//! What docs/DRIVERS.md shows is cut out of the files that are compiled here.

use std::fs;
use std::path::Path;

/// What stands between the marks of `name` in a source.
fn marked<'t>(source: &'t str, name: &str) -> Option<&'t str> {
    let (_, rest) = source.split_once(&format!("// ANCHOR: {name}\n"))?;
    rest.split_once("// ANCHOR_END").map(|(text, _)| text)
}

/// Blocks of a page that say where they are from: file, mark, text.
fn quoted(page: &str) -> Vec<(&str, &str, &str)> {
    page.split("<!-- docs/")
        .skip(1)
        .filter_map(|rest| {
            let (place, rest) = rest.split_once(" -->\n```rust\n")?;
            let (file, name) = place.split_once(": ")?;
            Some((file, name, rest.split_once("```")?.0))
        })
        .collect()
}

#[test]
fn the_page_shows_what_is_compiled() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let page = fs::read_to_string(docs.join("DRIVERS.md")).expect("the page");
    let blocks = quoted(&page);
    assert_eq!(blocks.len(), page.matches("```rust").count(), "every block of code says where it is from");
    assert!(blocks.len() >= 4);
    for (file, name, text) in blocks {
        let source = fs::read_to_string(docs.join(file)).expect("a file of this folder");
        assert_eq!(Some(text), marked(&source, name), "{file}: {name}");
    }
}

#[test]
fn a_block_that_differs_is_seen() {
    let page = "<!-- docs/a.rs: x -->\n```rust\nlet a = 1;\n```\n";
    assert_eq!(quoted(page), [("a.rs", "x", "let a = 1;\n")]);
    assert_eq!(marked("0\n// ANCHOR: x\nlet a = 2;\n// ANCHOR_END\n", "x"), Some("let a = 2;\n"));
    assert_eq!(marked("// ANCHOR: xy\n", "x"), None);
}
