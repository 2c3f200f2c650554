use pkm_dyn::urdf::parse;

use super::*;

const GOOD: &str = "\
robot = \"prs3\"
controller = \"controller.toml\"
[hal]
kind = \"simulated\"
[limits]
effort = 1200
velocity = [0.3, 0.3, 0.2]
[safe]
kind = \"hold\"
damping = 500.0
";

fn model() -> Model {
    let robot = pkm_robots::find("prs3").expect("shipped");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("it loads").robot.model
}

fn settings(text: &str) -> Result<Settings, ConfigError> {
    DaemonConfig::parse(text, "d.toml")?.settings(&model(), 200.0)
}

#[test]
fn what_is_left_out_is_the_robots_own_or_follows_from_the_period() {
    let s = settings(GOOD).unwrap();
    assert_eq!((s.limits.period_ns, s.limits.gate.stale_ns, s.limits.gate.late_ns), (5_000_000, 25_000_000, 15_000_000));
    assert_eq!((s.axes[0].effort, s.axes[2].velocity, s.axes[1].upper), (1200.0, 0.2, 0.3));
    assert!((s.limits.following[0] - 0.015).abs() < 1e-12);
    assert_eq!((s.limits.safe.damping[2], s.limits.safe.damping[3], s.priority, s.realtime), (500.0, 0.0, 80, Policy::Prefer));
    assert_eq!((s.black_box_s.to_bits(), s.length_s), (5.0_f64.to_bits(), None));
}

#[test]
fn every_refusal_names_file_line_key_value_and_limit() {
    let with = |from: &str, to: &str| settings(&GOOD.replace(from, to)).expect_err(to).to_string();
    for (from, to, want) in [
        ("effort = 1200", "effort = 1600", "d.toml:6: limits.effort = 1600 at joint \"q1\" (the robot's own limit is 1500)"),
        ("effort = 1200", "effort = nan", "d.toml:6: limits.effort = NaN at joint \"q1\" (must be 0 to "),
        ("effort = 1200", "effort = -1", "d.toml:6: limits.effort = -1 at joint \"q1\""),
        ("effort = 1200", "upper = 0.31", "d.toml:6: limits.upper = 0.31 at joint \"q1\" (the robot's own limit is 0.3)"),
        ("0.3, 0.2]", "0.3]", "d.toml:7: limits.velocity has 2 numbers (the robot has 3 drives)"),
        ("damping = 500.0", "stiffness = 1.0", "d.toml:1: safe.damping is missing"),
        ("kind = \"hold\"", "kind = \"fall\"", "d.toml:9: unknown variant `fall`"),
        ("[limits]", "[limit]", "d.toml:5: unknown field `limit`"),
        ("kind = \"simulated\"", "kind = \"simulated\"\nstale_s = 0.001", "d.toml:5: hal.stale_s = 0.001 (must be 0.005 to 60 s)"),
        ("kind = \"simulated\"", "kind = \"simulated\"\nwrench = \"foot\"", "d.toml:5: hal.wrench: the robot has no sensor \"foot\""),
        ("[safe]", "[loop]\npriority = 99\n[safe]", "d.toml:9: loop.priority = 99 (must be 1 to 98)"),
        ("[safe]", "[loop]\npriority = 7.5\n[safe]", "d.toml:9: loop.priority: must be a whole number"),
        ("[safe]", "[home]\nq = [0.1, 0.1, 0.4]\n[safe]", "d.toml:9: home.q = 0.4 at joint \"q8\" (its range is 0 to 0.3)"),
        // What the robot's side would refuse later is refused here.
        ("[0.3, 0.3, 0.2]", "[0.3, 0.0, 0.2]", "d.toml:7: limits.velocity = 0 at joint \"q6\" (must be positive)"),
        (
            "[safe]",
            "position_gain = 0\n[safe]",
            "d.toml:8: limits.position_gain = 0 at joint \"q1\" (must be finite and not negative, above 0",
        ),
        ("damping = 500.0", "damping = 500.0\neffort = 1.7976931348623157e308", "d.toml:11: safe.effort = 179769313486231570"),
        ("controller = \"controller.toml\"\n", "", "d.toml:1: missing field `controller`"),
        ("[safe]", "[run]\nlength_s = 9\n[safe]", "d.toml:9: run.length_s = 9: nothing runs"),
        ("[safe]", "[run]\nlength_s = 9\nmotion = \"m.csv\"\n[safe]", "d.toml:9: run.length_s = 9: run.motion has"),
        ("[safe]", "[run]\ncontroller = \"c\"\nlength_s = 0\n[safe]", "d.toml:10: run.length_s = 0 (must be 0.001 to 86400 s)"),
    ] {
        let told = with(from, to);
        assert!(told.starts_with(want), "{told}\nnot {want}");
        assert_eq!(told.lines().count(), 1);
    }
    let config = DaemonConfig::parse(GOOD, "d.toml").unwrap();
    for rate in [100.0, 4000.0] {
        assert!(config.settings(&model(), rate).is_ok(), "{rate} Hz");
    }
    for rate in [99.9, 4000.1, 1e6, 0.0, f64::NAN] {
        let told = config.settings(&model(), rate).expect_err("out of range").to_string();
        assert_eq!(told, format!("d.toml:2: controller: \"controller.toml\" has rate_hz = {rate} (must be 100 to 4000 Hz)"));
    }
}

#[test]
fn text_that_is_none_of_this_never_panics() {
    let mut bits = 0x9E37_79B9_7F4A_7C15_u64;
    for _ in 0..2000 {
        let mut text: Vec<u8> = GOOD.bytes().collect();
        for _ in 0..3 {
            // Xorshift (Marsaglia): any period longer than the test does.
            bits ^= bits << 13;
            bits ^= bits >> 7;
            bits ^= bits << 17;
            let at = usize::try_from(bits >> 8).unwrap_or(0) % text.len();
            text[at] = bits.to_le_bytes()[0] & 0x7F;
        }
        let _ = settings(&String::from_utf8(text).expect("ASCII"));
    }
    let deep = format!("a = {}1{}", "[".repeat(100_000), "]".repeat(100_000));
    assert!(settings(&deep).is_err());
}
