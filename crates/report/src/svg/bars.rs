//! One horizontal bar, to be set in a row with its label and its number.

use super::plot::whole;

/// A bar of the share `value` of the full width, with an optional mark at the share `mark`; `title` must be escaped already.
pub(crate) fn bar(value: f64, mark: Option<f64>, class: &str, title: &str) -> String {
    let width = |share: f64| if share.is_finite() { whole(1000.0 * share.clamp(0.0, 1.0)) } else { 0 };
    let mark = match mark {
        Some(m) if m.is_finite() && m > 0.0 => {
            format!(r#"<path class="mark under" d="M{0} -2V12"/><path class="mark" d="M{0} -2V12"/>"#, width(m))
        }
        _ => String::new(),
    };
    format!(
        concat!(
            r#"<svg class="bar" role="img" viewBox="0 0 1000 10" preserveAspectRatio="none"><title>{}</title>"#,
            r#"<rect class="track" width="1000" height="10"/><rect class="{}" width="{}" height="10"/>{}</svg>"#,
        ),
        title,
        class,
        width(value),
        mark
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_stay_inside_and_finite() {
        assert!(bar(7.0, Some(0.5), "c", "t").contains(r#"class="c" width="1000""#));
        assert!(bar(f64::NAN, Some(f64::NAN), "c", "t").contains(r#"class="c" width="0""#));
    }
}
