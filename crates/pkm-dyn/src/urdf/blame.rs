//! Where a URDF that the parser refuses is at fault: the parser tells what is wrong with a value, but neither its line nor its element.

use super::tree::{element, markup};

/// Attributes that are numbers, several where they are written in a row.
const NUMBERS: [&str; 24] = [
    "value",
    "xyz",
    "rpy",
    "ixx",
    "ixy",
    "ixz",
    "iyy",
    "iyz",
    "izz",
    "lower",
    "upper",
    "effort",
    "velocity",
    "damping",
    "friction",
    "multiplier",
    "offset",
    "radius",
    "length",
    "size",
    "scale",
    "rgba",
    "rising",
    "falling",
];

/// Elements whose attributes of those names are numbers; elsewhere, as in a transmission, they may be anything.
const HOLDERS: [&str; 15] = [
    "origin",
    "mass",
    "inertia",
    "limit",
    "dynamics",
    "axis",
    "mimic",
    "calibration",
    "safety_controller",
    "box",
    "cylinder",
    "sphere",
    "capsule",
    "mesh",
    "color",
];

/// Kinds of joint that the parser knows.
const JOINTS: [&str; 7] = ["revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical"];

/// The first value that is none of what it must be, in a line with its element; none where the fault is another.
pub(super) fn blame(text: &str) -> Option<String> {
    let mut at = 0;
    while let Some(start) = text[at..].find('<').map(|i| at + i) {
        let rest = &text[start..];
        let (end, _) = markup(rest)?;
        let (whole, name) = (&rest[..end.min(rest.len())], element(rest));
        if let Some(fault) = attributes(whole).find_map(|(key, value)| fault(name, key, value)) {
            let line = 1 + text[..start].matches('\n').count();
            return Some(format!("line {line}: <{name}>: {fault}"));
        }
        at = start + end;
    }
    None
}

fn fault(element: &str, key: &str, value: &str) -> Option<String> {
    if element == "joint" && key == "type" && !JOINTS.contains(&value) {
        return Some(format!("type = {value:?} (must be one of {})", JOINTS.join(", ")));
    }
    if !HOLDERS.contains(&element) || !NUMBERS.contains(&key) {
        return None;
    }
    let wrong = value.split_whitespace().find(|word| word.parse::<f64>().is_err());
    match wrong {
        Some(word) if word.contains(',') => Some(format!("{key} = {value:?}: {word:?} is no number (a decimal point, no comma)")),
        Some(word) => Some(format!("{key} = {value:?}: {word:?} is no number")),
        None if value.trim().is_empty() => Some(format!("{key} = {value:?}: no number")),
        None => None,
    }
}

/// Attributes of an opening tag: names and quoted values.
fn attributes(tag: &str) -> impl Iterator<Item = (&str, &str)> {
    let mut rest = tag;
    core::iter::from_fn(move || {
        let (before, after) = rest.split_once('=')?;
        let key = before.split_whitespace().next_back()?;
        let after = after.trim_start();
        let quote = after.chars().next().filter(|c| matches!(c, '"' | '\''))?;
        let (value, left) = after[1..].split_once(quote)?;
        rest = left;
        Some((key, value))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_value_that_is_no_number_is_told_with_its_line() {
        let robot = |mass: &str, kind: &str| {
            format!(
                "<robot name='r'>\n<!-- <mass value=\"x\"/> -->\n<link name=\"a\"><inertial>\n<mass value={mass}/></inertial></link>\n<joint name=\"j\" type=\"{kind}\">\n<limit lower=\"-1\" upper=\"1e3\"/></joint></robot>"
            )
        };
        assert_eq!(blame(&robot("\"1.4\"", "revolute")), None);
        let told = blame(&robot("'1,4'", "revolute")).unwrap();
        assert_eq!(told, "line 4: <mass>: value = \"1,4\": \"1,4\" is no number (a decimal point, no comma)");
        let told = blame(&robot("\"1.4\"", "rotary")).unwrap();
        assert!(told.starts_with("line 5: <joint>: type = \"rotary\" (must be one of revolute,"), "{told}");
        // Nothing is said of what others keep in a URDF, and of text without an end.
        assert_eq!(blame("<transmission><joint><offset value=\"a\"/></joint></transmission><mass value="), None);
    }
}
