//! `pkm export`. That the files mean the same robot is shown in Python, by Pinocchio and MuJoCo themselves.

use std::fs;

use crate::fixture::{RIG_TOML, RIG_URDF, names, prints, refused, rig};

#[test]
fn every_shipped_robot_is_exported() {
    let folder = tempfile::tempdir().unwrap();
    for robot in pkm_robots::ALL {
        let (xml, dir) = (format!("{}.xml", robot.name), format!("for/{}", robot.name));
        assert!(prints(folder.path(), &["export", robot.name, "--format", "mjcf", "--out", &xml]).contains(&xml));
        assert!(fs::read_to_string(folder.path().join(&xml)).unwrap().contains("<key name=\"home\""), "{xml}");
        prints(folder.path(), &["export", robot.name, "--format", "gepetto", "--out", &dir]);
        assert_eq!(names(&folder.path().join(&dir)), ["robot.urdf", "robot.yaml"]);
        let yaml = fs::read_to_string(folder.path().join(&dir).join("robot.yaml")).unwrap();
        assert!(yaml.contains("closed_loop: [") && yaml.contains("name_mot: ["), "{yaml}");
    }
}

#[test]
fn an_exported_urdf_is_a_robot_for_pkm_too() {
    let folder = rig();
    prints(folder.path(), &["export", "rig.toml", "--format", "gepetto", "--out", "out"]);
    fs::copy(folder.path().join("out/robot.urdf"), folder.path().join("rig.urdf")).unwrap();
    prints(folder.path(), &["check", "rig.toml"]);
}

#[test]
fn nothing_is_overwritten_unless_it_is_asked_for() {
    let folder = rig();
    let mjcf = ["export", "rig.toml", "--format", "mjcf", "--out", "rig.xml"];
    prints(folder.path(), &mjcf);
    fs::write(folder.path().join("rig.xml"), "mine").unwrap();
    refused(folder.path(), &mjcf, &["rig.xml", "exists already", "--force"]);
    assert_eq!(fs::read_to_string(folder.path().join("rig.xml")).unwrap(), "mine");
    prints(folder.path(), &[&mjcf[..], &["--force"]].concat());
    assert!(fs::read_to_string(folder.path().join("rig.xml")).unwrap().contains("<mujoco"));
    let onto_input = ["export", "rig.toml", "--format", "mjcf", "--out", "rig.urdf", "--force"];
    refused(folder.path(), &onto_input, &["rig.urdf", "overwrite the input"]);
    fs::create_dir(folder.path().join("full")).unwrap();
    fs::write(folder.path().join("full/robot.yaml"), "mine").unwrap();
    refused(folder.path(), &["export", "rig.toml", "--format", "gepetto", "--out", "full"], &["robot.yaml", "--force"]);
    assert_eq!(names(&folder.path().join("full")), ["robot.yaml"]);
}

#[test]
fn what_a_format_cannot_say_is_told() {
    let folder = rig();
    let effect = "\n[[effect]]\nname = \"torque_ripple\"\nwhere = \"j2\"\nparameters = { amplitude = 1.0, order = 3.0 }\n";
    fs::write(folder.path().join("rig.toml"), format!("{RIG_TOML}{effect}")).unwrap();
    let said = prints(folder.path(), &["export", "rig.toml", "--format", "mjcf", "--out", "rig.xml"]);
    assert!(said.contains("note: effect torque_ripple at \"j2\" is left out"), "{said}");
    assert!(fs::read_to_string(folder.path().join("rig.xml")).unwrap().contains("effect torque_ripple at"));
}

#[test]
fn robots_that_another_program_cannot_have_are_refused() {
    let folder = rig();
    let mjcf = ["export", "rig.toml", "--format", "mjcf", "--out", "rig.xml"];
    let gepetto = ["export", "rig.toml", "--format", "gepetto", "--out", "for_pinocchio"];
    let closed = |axes: &str| {
        let driven = RIG_TOML.split("\n[[actuator]]\njoint = \"j2\"").next().unwrap();
        let ends = "name = \"yoke\"\na = { link = \"base\", xyz = [0.6, 0, 0] }\nb = { link = \"hand\", xyz = [0.3, 0, 0] }";
        format!("{driven}\n[[loop]]\n{ends}\nconstrain = [{axes}]\n")
    };
    fs::write(folder.path().join("rig.toml"), closed("\"z\"")).unwrap();
    refused(folder.path(), &mjcf, &["rig.toml", "loop \"yoke\": z ", "MuJoCo", "another of its joints"]);
    prints(folder.path(), &gepetto);
    fs::remove_dir_all(folder.path().join("for_pinocchio")).unwrap();
    // One component of the rotation vector alone: two free ones are no two hinges in series.
    let arm = pkm_robots::find("serial_arm").unwrap();
    let wrist = arm.toml.split("[[actuator]]\njoint = \"j6\"").next().unwrap();
    let (base, tool) = ("base", "flange");
    let turn = format!("[[loop]]\nname = \"yoke\"\na = {{ link = \"{base}\" }}\nb = {{ link = \"{tool}\" }}\nconstrain = [\"rz\"]\n");
    fs::write(folder.path().join("arm.toml"), format!("{wrist}\n{turn}")).unwrap();
    fs::write(folder.path().join("serial_arm.urdf"), arm.urdf).unwrap();
    let onto = ["--out", "for_pinocchio"];
    let parts = ["arm.toml", "loop \"yoke\": rz ", "toolbox-parallel-robots"];
    refused(folder.path(), &[&["export", "arm.toml", "--format", "gepetto"][..], &onto].concat(), &parts);
    let open = closed("\"x\", \"z\"").replace("[0.6, 0, 0]", "[0.9, 0, 0]");
    fs::write(folder.path().join("rig.toml"), open).unwrap();
    refused(folder.path(), &mjcf, &["rig.toml", "loop \"yoke\"", "open (limit 1e-9)"]);
    fs::write(folder.path().join("rig.toml"), RIG_TOML).unwrap();
    fs::write(folder.path().join("rig.urdf"), RIG_URDF.replacen("izz=\"0.02\"", "izz=\"0.2\"", 1)).unwrap();
    refused(folder.path(), &mjcf, &["rig.toml", "\"arm\"", "0.2", "MuJoCo"]);
    refused(folder.path(), &["export", "rig.toml", "--format", "sdf", "--out", "x"], &["sdf", "mjcf", "gepetto"]);
}
