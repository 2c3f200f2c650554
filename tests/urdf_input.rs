//! Robots that are no robots: every refusal is one line with file, place, value and limit; nothing panics, nothing overflows the stack.

use std::fs;
use std::path::Path;

use pkm_dyn::urdf::{load, parse};
use pkm_tests::Draw;

const TOML: &str = r#"name = "four_bar"
urdf = "four_bar.urdf"

[[loop]]
name = "pin"
a = { link = "rocker", xyz = [0.5, 0.0, 0.0] }
b = { link = "coupler", xyz = [0.6, 0.0, 0.0] }
constrain = ["x", "y"]

[assembly]
rocker_hinge = 0.9

[[actuator]]
joint = "crank_hinge"
rotor_inertia = 0.01

[[sensor]]
name = "tip"
kind = "wrench"
link = "coupler"

[[effect]]
name = "friction_coulomb"
where = "crank_hinge"
parameters = { coulomb = 0.2 }
"#;

const URDF: &str = r#"<?xml version="1.0"?>
<robot name="four_bar">
  <link name="base"/>
  <link name="crank"><inertial><origin xyz="0.1 0 0"/><mass value="0.5"/><inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
  <link name="coupler"><inertial><mass value="0.7"/><inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
  <link name="rocker"/>
  <joint name="crank_hinge" type="revolute"><parent link="base"/><child link="crank"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="10" velocity="10"/></joint>
  <joint name="coupler_hinge" type="continuous"><parent link="crank"/><child link="coupler"/><origin xyz="0.2 0 0" rpy="0 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="rocker_hinge" type="revolute"><parent link="base"/><child link="rocker"/><origin xyz="0.5 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="10" velocity="10"/></joint>
</robot>
"#;

const NAMES: [&str; 2] = ["robot.toml", "robot.urdf"];

fn refusal(toml: &str, urdf: &str) -> String {
    let message = parse(toml, urdf, NAMES).expect_err("this is no robot").to_string();
    assert!(!message.contains('\n') && message.len() < 400, "one line: {message}");
    message
}

/// The message after replacing `old` in one of the two texts must name the file and every one of `wanted`.
fn check(old: &str, new: &str, file: &str, wanted: &[&str]) {
    let (toml, urdf) =
        if file == NAMES[0] { (TOML.replacen(old, new, 1), URDF.to_string()) } else { (TOML.to_string(), URDF.replacen(old, new, 1)) };
    assert!(toml != TOML || urdf != URDF, "{old:?} is not in the text");
    let message = refusal(&toml, &urdf);
    assert!(message.starts_with(&format!("{file}: ")), "{message}");
    for part in wanted {
        assert!(message.contains(part), "{part:?} is not named: {message}");
    }
}

fn check_toml(old: &str, new: &str, wanted: &[&str]) {
    check(old, new, NAMES[0], wanted);
}

fn check_urdf(old: &str, new: &str, wanted: &[&str]) {
    check(old, new, NAMES[1], wanted);
}

#[test]
fn the_sound_robot_reads() {
    let robot = parse(TOML, URDF, NAMES).expect("a robot");
    assert_eq!((robot.bare.nv(), robot.bare.n_act(), robot.robot.effects.len()), (3, 1, 1));
}

#[test]
fn unknown_keys_are_named_with_their_line() {
    check_toml("rotor_inertia", "rotor_inertai", &["line 15", "rotor_inertai"]);
    check_toml("kind =", "kidn =", &["line 19", "kidn"]);
    check_toml("urdf =", "gravitation = 9.81\nurdf =", &["line 2", "gravitation"]);
    check_toml("rotor_inertia = 0.01", "rotor_inertia = \"heavy\"", &["line 15", "string"]);
}

#[test]
fn unknown_names_are_named_with_their_place() {
    check_toml("link = \"rocker\"", "link = \"rokcer\"", &["loop \"pin\"", "link", "rokcer"]);
    check_toml("joint = \"crank_hinge\"", "joint = \"crank\"", &["actuator", "joint", "\"crank\""]);
    check_toml("rocker_hinge = 0.9", "roker_hinge = 0.9", &["assembly", "roker_hinge"]);
    check_toml("link = \"coupler\"\n", "link = \"cuopler\"\n", &["sensor \"tip\"", "cuopler"]);
    check_toml("\"wrench\"", "\"wench\"", &["sensor \"tip\"", "wench"]);
    check_toml("[\"x\", \"y\"]", "[\"x\", \"Y\"]", &["loop \"pin\"", "\"Y\"", "x y z rx ry rz"]);
    check_toml("[\"x\", \"y\"]", "[]", &["loop \"pin\"", "constrain"]);
    check_urdf("<parent link=\"crank\"/>", "<parent link=\"cark\"/>", &["joint \"coupler_hinge\"", "cark"]);
}

#[test]
fn doubles_are_refused() {
    check_toml("[[sensor]]", "[[actuator]]\njoint = \"crank_hinge\"\n[[sensor]]", &["actuator", "crank_hinge", "twice"]);
    let again = "[[loop]]\nname = \"pin\"\na = { link = \"rocker\" }\nb = { link = \"crank\" }\nconstrain = [\"z\"]\n[assembly]";
    check_toml("[assembly]", again, &["loop", "pin", "twice"]);
    check_toml("[[effect]]", "[[sensor]]\nname = \"tip\"\nkind = \"pose\"\nlink = \"base\"\n[[effect]]", &["sensor", "tip", "twice"]);
    check_urdf("<link name=\"rocker\"/>", "<link name=\"rocker\"/><link name=\"crank\"/>", &["link", "crank", "twice"]);
    check_urdf("name=\"coupler_hinge\"", "name=\"crank_hinge\"", &["joint", "crank_hinge", "twice"]);
}

#[test]
fn numbers_outside_their_limits_are_refused() {
    check_urdf("mass value=\"0.5\"", "mass value=\"-0.5\"", &["link \"crank\"", "mass", "-0.5", "kg", ">= 0"]);
    check_urdf("mass value=\"0.5\"", "mass value=\"NaN\"", &["link \"crank\"", "NaN", "finite"]);
    check_urdf("ixx=\"0.001\"", "ixx=\"inf\"", &["link \"crank\"", "finite"]);
    check_urdf("axis xyz=\"0 0 1\"", "axis xyz=\"0 0 0\"", &["joint \"crank_hinge\"", "axis", "> 0"]);
    check_urdf("origin xyz=\"0.2 0 0\"", "origin xyz=\"0.2 nan 0\"", &["joint \"coupler_hinge\"", "origin", "finite"]);
    check_urdf("lower=\"-3\" upper=\"3\"", "lower=\"3\" upper=\"-3\"", &["joint \"crank_hinge\"", "lower", "3", "upper"]);
    check_urdf("<limit", "<dynamics damping=\"-1\" friction=\"0\"/><limit", &["joint \"crank_hinge\"", "damping", "-1", ">= 0"]);
    check_toml("rotor_inertia = 0.01", "rotor_inertia = -0.01", &["actuator \"crank_hinge\"", "-0.01", ">= 0"]);
    check_toml("[0.5, 0.0, 0.0]", "[nan, 0.0, 0.0]", &["loop \"pin\"", "NaN", "finite"]);
    check_toml("urdf =", "gravity = [0.0, 0.0, inf]\nurdf =", &["gravity", "inf", "finite"]);
    check_toml("rocker_hinge = 0.9", "rocker_hinge = inf", &["assembly", "rocker_hinge", "inf", "finite"]);
}

#[test]
fn links_that_are_no_tree_are_refused() {
    check_urdf("<link name=\"base\"/>", "<link name=\"base\"/><link name=\"island\"/>", &["base", "island", "roots"]);
    check_urdf("<child link=\"rocker\"/>", "<child link=\"coupler\"/>", &["coupler", "two joints"]);
    let cycle = r#"<link name="a"/><link name="b"/><joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint><joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint>"#;
    check_urdf("<link name=\"base\"/>", &format!("<link name=\"base\"/>{cycle}"), &["tree", "\"a\"", "base"]);
    let ring = r#"<robot name="r"><link name="a"/><joint name="j" type="continuous"><parent link="a"/><child link="a"/><axis xyz="0 0 1"/></joint></robot>"#;
    assert!(refusal(TOML, ring).contains("root"));
    assert!(refusal(TOML, "<robot name=\"r\"></robot>").starts_with("robot.urdf: "));
}

#[test]
fn joints_of_several_coordinates_are_read_and_cannot_be_driven_or_coupled_alone() {
    for (kind, coordinates) in [("planar", 3), ("floating", 6), ("spherical", 3)] {
        let urdf = URDF.replace("type=\"continuous\"", &format!("type=\"{kind}\""));
        let model = parse(TOML, &urdf, ["robot.toml", "robot.urdf"]).expect("it reads").bare;
        assert_eq!(model.nv(), 2 + coordinates);
        let driven = format!("{TOML}\n[[actuator]]\njoint = \"coupler_hinge.rz\"\n");
        let line = refusal(&driven, &urdf);
        assert!(line.contains("coupler_hinge.rz") && line.contains("series"), "{line}");
        let coupled = format!("{TOML}\n[[coupling]]\njoint = \"rocker_hinge\"\nof = {{ \"coupler_hinge.rz\" = 1.0 }}\n");
        let line = refusal(&coupled, &urdf);
        assert!(line.contains("coupler_hinge.rz") && line.contains("coupled"), "{line}");
    }
    check_urdf("type=\"continuous\"", "type=\"bendy\"", &["bendy"]);
}

#[test]
fn couplings_must_lead_somewhere() {
    let coupling = |joint: &str, of: &str| format!("[[coupling]]\njoint = \"{joint}\"\nof = {{ {of} }}\n[assembly]");
    check_toml("[assembly]", &coupling("rocker_hinge", "rocker_hinge = 1.0"), &["rocker_hinge", "itself"]);
    check_toml("[assembly]", &coupling("rocker_hinge", "elbow = 1.0"), &["coupling", "rocker_hinge", "elbow"]);
    check_toml("[assembly]", &coupling("elbow", "rocker_hinge = 1.0"), &["coupling", "elbow"]);
    check_toml("[assembly]", &coupling("rocker_hinge", "crank_hinge = nan"), &["rocker_hinge", "ratio", "NaN", "finite"]);
    check_toml("[assembly]", &coupling("crank_hinge", "rocker_hinge = 1.0"), &["crank_hinge", "driven"]);
    check_urdf("<axis", "<mimic joint=\"elbow\"/><axis", &["crank_hinge", "elbow"]);
    check_urdf("<axis", "<mimic joint=\"crank_hinge\"/><axis", &["crank_hinge", "itself"]);
}

#[test]
fn effects_must_be_in_the_library_at_a_fitting_place_with_sound_parameters() {
    check_toml("friction_coulomb", "friction_colomb", &["friction_colomb", "library"]);
    check_toml("where = \"crank_hinge\"", "where = \"crank\"", &["friction_coulomb", "\"crank\"", "joint"]);
    check_toml("\"friction_coulomb\"", "\"friction_passive\"", &["friction_passive", "crank_hinge", "passive joint"]);
    check_toml("{ coulomb = 0.2 }", "{ }", &["friction_coulomb", "coulomb", "missing"]);
    check_toml("{ coulomb = 0.2 }", "{ coulomb = -0.2 }", &["friction_coulomb", "coulomb", "-0.2", ">= 0"]);
    check_toml("{ coulomb = 0.2 }", "{ coulomb = nan }", &["friction_coulomb", "coulomb", "NaN", "finite"]);
    check_toml("{ coulomb = 0.2 }", "{ coulomb = 0.2, stiction = 1.0 }", &["friction_coulomb", "stiction", "unknown", "coulomb"]);
    check_toml("name = \"friction_coulomb\"\nwhere = \"crank_hinge\"", "name = \"payload\"\nwhere = \"crank_hinge\"", &["payload", "link"]);
    check_toml(
        "name = \"friction_coulomb\"\nwhere = \"crank_hinge\"",
        "name = \"gravity_tilt\"\nwhere = \"crank\"",
        &["gravity_tilt", "root link"],
    );
}

#[test]
fn a_robot_without_drives_is_refused() {
    check_toml("[[actuator]]\njoint = \"crank_hinge\"\nrotor_inertia = 0.01\n", "", &["actuator"]);
}

#[test]
fn elements_that_do_not_close_are_told_with_their_lines() {
    let cases = [
        ("<robot name=\"r\">\n<link name=\"base\"/>\n", "line 1: <robot> is never closed: the file ends without </robot>"),
        ("<robot name=\"r\">\n<link name=\"base\">\n</robot>\n", "line 3: </robot> closes nothing: <link> of line 2 is open there"),
        ("<robot name=\"r\">\n<link name=\"base\"/>\n</robot >\n</robot>", "line 4: </robot> closes nothing: nothing is open there"),
        ("<robot name=\"r\">\n<link name=\"base", "line 2: <link> is never closed: the file ends without </link>"),
    ];
    for (text, told) in cases {
        assert!(refusal(TOML, text).contains(told), "{}", refusal(TOML, text));
    }
    // Names that are longer than an error, cut between the bytes of a letter.
    let _ = refusal(TOML, &format!("<robot name=\"r\"><{}", "\u{e9}".repeat(100)));
}

fn nested(open: &str, close: &str, depth: usize) -> String {
    format!("<robot name=\"r\"><link name=\"base\">{}{}</link></robot>", open.repeat(depth), close.repeat(depth))
}

#[test]
fn deep_nesting_is_refused_before_the_stack_overflows() {
    assert!(refusal(TOML, &nested("<a>", "</a>", 10_000)).contains("nested deeper than 64"));
    assert!(refusal(TOML, &nested("<a>\n", "</a>", 10_000)).contains("line 6"));
    // Signs that only look like ends of elements must not hide the depth.
    for open in ["<a b=\"/>\">", "<a><!-- </a> -->", "<a><![CDATA[</a>]]>", "<a b='/>'>", "<a c=\"</a>\">", "<a><?p />?>"] {
        let _ = refusal(TOML, &nested(open, "</a>", 10_000));
    }
    let declared = format!("<!DOCTYPE r [<!ENTITY e \"{}\">]>\n{}", "<a>".repeat(10_000), nested("&e;", "</a>", 1));
    assert!(refusal(TOML, &declared).contains("line 1: a URDF has no <!DOCTYPE>"));
    let deep_array = format!("name = {}1{}\n", "[".repeat(10_000), "]".repeat(10_000));
    let _ = refusal(&deep_array, URDF);
    let deep_table = format!("name = {}1{}\n", "{ a = ".repeat(10_000), " }".repeat(10_000));
    let _ = refusal(&deep_table, URDF);
    let _ = refusal(&format!("{} = 1\n", vec!["a"; 10_000].join(".")), URDF);
}

#[test]
fn comments_may_hold_any_number_of_elements() {
    let urdf = URDF.replace("<link name=\"base\"/>", &format!("<!-- {} --><link name=\"base\"/>", "<link> ".repeat(200)));
    assert!(parse(TOML, &urdf, NAMES).is_ok());
}

#[test]
fn long_chains_read_and_endless_ones_are_refused() {
    let chain = |n: usize| {
        let links: String = (0..=n).map(|k| format!("<link name=\"l{k}\"/>")).collect();
        let joint = |k| format!("<joint name=\"j{k}\" type=\"fixed\"><parent link=\"l{k}\"/><child link=\"l{}\"/></joint>", k + 1);
        let joints: String = (1..n).map(joint).collect();
        let first = "<joint name=\"j0\" type=\"continuous\"><parent link=\"l0\"/><child link=\"l1\"/><axis xyz=\"0 0 1\"/></joint>";
        format!("<robot name=\"chain\">{links}{first}{joints}</robot>")
    };
    let toml = "name = \"chain\"\nurdf = \"c.urdf\"\n[[actuator]]\njoint = \"j0\"\n";
    assert_eq!(parse(toml, &chain(1500), NAMES).expect("long, but a tree").bare.nv(), 1);
    assert!(refusal(toml, &chain(3000)).contains("3001 links (limit 2000)"));
    let many = "<joint name=\"j\" type=\"fixed\"><parent link=\"base\"/><child link=\"crank\"/></joint>".repeat(100_000);
    assert!(refusal(TOML, &URDF.replace("</robot>", &format!("{many}</robot>"))).contains("100003 joints (limit 2000)"));
}

#[test]
fn text_cut_anywhere_is_refused_without_a_panic() {
    let end = URDF.rfind("</robot>").expect("an end");
    for cut in (0..end).filter(|&c| URDF.is_char_boundary(c)) {
        let _ = refusal(TOML, &URDF[..cut]);
    }
    for cut in 0..TOML.len() {
        // A robot.toml cut between two tables can be a robot: it must only not panic.
        let _ = parse(&TOML[..cut], URDF, NAMES);
    }
    assert!(refusal("", URDF).starts_with("robot.toml: line 1: "));
    assert!(refusal(TOML, "").starts_with("robot.urdf: "));
}

#[test]
fn text_with_changed_bytes_never_panics() {
    let mut draw = Draw::new(99);
    let pool = b"<>/=\"'[]{}.-+0e \n\0&;#xNaN";
    for _ in 0..3000 {
        let mut texts = [TOML.as_bytes().to_vec(), URDF.as_bytes().to_vec()];
        for _ in 0..=draw.choice(4) {
            let text = &mut texts[draw.choice(2)];
            let at = draw.choice(text.len());
            text[at] = pool[draw.choice(pool.len())];
        }
        let [toml, urdf] = texts.map(|t| String::from_utf8_lossy(&t).into_owned());
        if let Err(e) = parse(&toml, &urdf, NAMES) {
            let message = e.to_string();
            assert!(!message.contains('\n') && message.starts_with("robot."), "{message}");
        }
    }
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("robot.toml"), TOML).expect("written");
    fs::write(folder.path().join("four_bar.urdf"), URDF).expect("written");
    folder
}

fn refused_file(path: &Path, wanted: &[&str]) {
    let message = load(path).expect_err("this is no robot").to_string();
    assert!(!message.contains('\n'), "one line: {message}");
    for part in wanted {
        assert!(message.contains(part), "{part:?} is not named: {message}");
    }
}

#[test]
fn files_that_are_no_robots_are_refused_by_name() {
    let folder = folder();
    let (toml, urdf) = (folder.path().join("robot.toml"), folder.path().join("four_bar.urdf"));
    assert!(load(&toml).is_ok());
    refused_file(&folder.path().join("other.toml"), &["other.toml"]);
    refused_file(folder.path(), &[]);
    fs::write(&urdf, "").expect("written");
    refused_file(&toml, &["four_bar.urdf", "empty"]);
    fs::write(&urdf, b"<robot name=\"r\xFF\"/>").expect("written");
    refused_file(&toml, &["four_bar.urdf", "byte 14", "UTF-8"]);
    let big = fs::File::create(&urdf).expect("created");
    big.set_len(20_000_001).expect("a sparse file");
    refused_file(&toml, &["four_bar.urdf", "20000000 bytes", "limit"]);
    if cfg!(target_os = "linux") {
        refused_file(Path::new("/dev/zero"), &["/dev/zero", "20000000 bytes"]);
    }
    fs::remove_file(&urdf).expect("removed");
    refused_file(&toml, &["four_bar.urdf"]);
    fs::write(&toml, "").expect("written");
    refused_file(&toml, &["robot.toml", "empty"]);
    fs::write(&toml, [0xFF, 0xFE, 0x00]).expect("written");
    refused_file(&toml, &["robot.toml", "byte 0", "UTF-8"]);
    let text = format!("<robot name=\"r\">{}</robot>", " ".repeat(20_000_001));
    assert!(refusal(TOML, &text).contains("limit 20000000"));
}
