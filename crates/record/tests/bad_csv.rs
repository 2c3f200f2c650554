//! Every way a CSV file can be wrong is one line that says where.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]
mod made_up;

use made_up::{Noise, file, read};

fn say(content: &[u8]) -> String {
    let (_guard, path) = file("A.csv", content);
    let text = read(&path).unwrap_err().to_string();
    assert!(!text.contains('\n'), "{text}");
    text.replace(&path.display().to_string(), "A.csv")
}

#[test]
fn every_message_names_the_place() {
    let cases: [(&[u8], &str); 28] = [
        (b"", "A.csv: the file is empty"),
        (b"\xEF\xBB\xBF\r\n", "A.csv: the file is empty"),
        (b"# tau = measured\n", "A.csv: no header line with column names"),
        (b"t,q.a\n", "A.csv: no samples"),
        (b"time,q.a\n0,1\n", "A.csv line 1: no column t, the time in seconds (columns: time, q.a)"),
        (b"t;q.a\n0;1\n", "A.csv line 1: no column t, the time in seconds (columns: t;q.a): fields must be separated by commas"),
        (b"t,q.a,q.a\n0,1,1\n", "A.csv line 1: column q.a is there twice"),
        (b"t,t\n0,1\n", "A.csv line 1: column t is there twice"),
        (b"t,,q.a\n0,1,1\n", "A.csv line 1: column number 2 has no name"),
        (b"t,tau.q1\n0,1\n1,abc\n", "A.csv line 3, column tau.q1: \"abc\" is not a number"),
        (b"t,a\n0,1_000\n", "A.csv line 2, column a: \"1_000\" is not a number"),
        (b"t,a\n0,\xff\n", "A.csv line 2, column a: \"\u{fffd}\" is not a number"),
        (b"t,a\n0,inf\n", "A.csv line 2, column a: \"inf\" is not finite"),
        (b"t,a\n0,-1e999\n", "A.csv line 2, column a: \"-1e999\" is not finite"),
        (b"t,a\n0,1\n,2\n", "A.csv line 3, column t: \"\" is not finite"),
        (b"t,a\nnan,1\n", "A.csv line 2, column t: \"nan\" is not finite"),
        (b"t,a\n0,1,2\n", "A.csv line 2: 3 fields, the header has 2"),
        (b"t,a,b\n0,1\n", "A.csv line 2: 2 fields, the header has 3"),
        (b"t,a\n0,1,5\n", "A.csv line 2: 3 fields, the header has 2"),
        (b"t\n0.04\n0.03\n", "A.csv line 3: t = 0.03 s does not increase (line before: 0.04 s)"),
        (b"# note\n\nt\n1\n# c\n1\n", "A.csv line 6: t = 1 s does not increase (line before: 1 s)"),
        (b"t,\xff\n0,1\n", "A.csv line 1: not UTF-8 text"),
        (b"# tau = current\nt\n0\n", "A.csv line 1: tau = current is not measured or commanded"),
        (b"# tau = measured\n# tau = commanded\nt\n0\n", "A.csv line 2: tau is given twice"),
        (
            b"# load = {link = \"p\"}\nt\n0\n",
            "A.csv line 1: load = {link = \\\"p\\\"} is not {link = \"<name>\", mass = <kg>, xyz = [<m>, <m>, <m>]}: missing field `mass`",
        ),
        (b"# gravity = [0, 1]\nt\n0\n", "A.csv line 1: gravity = [0, 1] is not [<m/s\u{b2}>, <m/s\u{b2}>, <m/s\u{b2}>]"),
        (b"# gravity = [0, 1, inf]\nt\n0\n", "A.csv line 1: gravity = [0, 1, inf] is not [<m/s\u{b2}>, <m/s\u{b2}>, <m/s\u{b2}>], finite"),
        (b"# session = [1]\nt\n0\n", "A.csv line 1: session = [1] is not a text in quotes or one bare word"),
    ];
    for (content, message) in cases {
        assert_eq!(say(content), message);
    }
}

#[test]
fn a_hostile_field_makes_a_short_line() {
    let mut content = b"t,a\n0,".to_vec();
    content.extend(core::iter::repeat_n(b"\x1b[31m\r", 100_000).flatten());
    let text = say(&content);
    assert!(text.len() < 600 && !text.contains('\x1b'), "{text}");
}

#[test]
fn missing_files_and_other_formats_are_told_apart() {
    assert!(read("none.csv".as_ref()).unwrap_err().to_string().starts_with("none.csv: "));
    assert_eq!(read("A.bag".as_ref()).unwrap_err().to_string(), "A.bag: unknown kind of recording (known: .csv, .mcap)");
    let (_guard, path) = file("A.mcap", b"t,q.a\n0,1\n");
    assert!(read(&path).unwrap_err().to_string().ends_with("not an MCAP file (its first 8 bytes are not the MCAP magic)"));
    let (_guard, path) = file("A.mcap", b"");
    assert!(read(&path).unwrap_err().to_string().ends_with("the file is empty"));
}

#[test]
fn fewer_than_three_samples_are_left_to_the_gate() {
    let (_guard, path) = file("A.csv", b"t,q.a\n0,1");
    assert_eq!(read(&path).unwrap().len(), 1);
}

#[test]
fn random_bytes_never_panic() {
    let whole = b"# tau = measured\n# load = {link = \"p\", mass = 2.0}\n# gravity = [0,0,1]\nt,q.a,\"b,c\"\n0,1,2\n0.5,nan,-3e4\n1,,7\n";
    let mut noise = Noise(11);
    let (_guard, path) = file("A.csv", b"");
    for _ in 0..3000 {
        let mut content = whole.to_vec();
        for _ in 0..=noise.below(4) {
            let at = noise.below(content.len());
            content[at] = b"\xff\0\",#=\n\r[{ t"[noise.below(12)];
        }
        std::fs::write(&path, &content).unwrap();
        let _ = read(&path);
    }
}
