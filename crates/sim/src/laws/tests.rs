//! Stating forms, and what all of them keep to.

use pkm_dyn::effects::{JointState, find};
use pkm_dyn::math;
use pkm_dyn::model::Model;

use super::{FORMS, ForeignLaw, parse};

fn robot() -> Model {
    let robot = pkm_robots::find("prs3").expect("a shipped robot");
    pkm_dyn::urdf::parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("it reads").bare
}

/// With every required parameter at 0.5.
fn text(form: &super::Form) -> String {
    let required: Vec<String> = form.parameters.iter().filter(|p| p.default.is_none()).map(|p| format!("{}=0.5", p.name)).collect();
    format!("{}@q1:form={},{}", form.effects[0], form.name, required.join(","))
}

fn law(form: &super::Form, model: &Model) -> Box<dyn ForeignLaw> {
    parse(&text(form), model).expect("required parameters suffice").expect("a form")
}

#[test]
fn every_form_is_of_an_effect_and_stated_with_its_required_parameters() {
    let model = robot();
    for form in FORMS {
        assert!(form.effects.iter().all(|e| find(e).is_some()), "{}", form.name);
        assert_eq!(law(form, &model).joint(), model.joint_index("q1").unwrap(), "{}", form.name);
    }
}

#[test]
fn ten_different_effects_have_another_form() {
    let effects: alloc::collections::BTreeSet<&str> = FORMS.iter().flat_map(|f| f.effects.iter().copied()).collect();
    assert!(effects.len() >= 10, "{effects:?}");
}

#[test]
fn what_is_not_understood_is_said_in_one_line() {
    let model = robot();
    for (text, part) in [
        ("friction_stribeck@q1:form=nothing", "form \"nothing\" is unknown (has: lugre"),
        ("gravity_tilt@base:form=lugre", "(has: none)"),
        ("friction_stribeck@q99:form=lorentzian", "\"q99\" is not a joint"),
        ("friction_stribeck@q1:form=lorentzian,coulomb=1", "\"stiction\" is missing"),
        ("friction_stribeck@q1:form=lorentzian,coulomb=x", "= \"x\" is not a number"),
        ("friction_stribeck@q1:form=lorentzian,coulomb=-1", "= -1 (must be finite and 0"),
        ("friction_stribeck@q1:form=lorentzian,coulomb=1,coulomb=2", "is given twice"),
        ("friction_stribeck@q1:form=lorentzian,colour=1", "is unknown (has: coulomb"),
        ("friction_stribeck:form=lorentzian", "no @"),
    ] {
        let said = parse(text, &model).expect_err(text).to_string();
        assert!(said.contains(part) && !said.contains('\n'), "{said}");
    }
    assert!(parse("friction_stribeck@q1:coulomb=1", &model).expect("the catalogue's own").is_none());
}

#[test]
fn levels_stay_in_order_and_finite_along_a_rough_motion() {
    let model = robot();
    for form in FORMS {
        let mut law = law(form, &model);
        let h = 1e-3;
        for i in 0..4000 {
            let t = h * f64::from(i);
            let (w, v_top) = (7.0, 0.4);
            let v = v_top * math::sin(w * t) * math::sin(0.9 * t);
            let state = JointState {
                q: 0.1 * math::sin(3.0 * t),
                v,
                a: 0.5,
                load: 20.0 * math::cos(2.0 * t),
                time: t,
                warmth: t,
                ..JointState::default()
            };
            let (low, high) = law.levels(&state);
            assert!(low.is_finite() && high.is_finite() && low <= high, "{} at {t} s: {low} {high}", form.name);
            law.advance(&state, h);
        }
    }
}
