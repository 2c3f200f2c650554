//! Poses of a scan in words.

use pkm_dyn::workspace::Scan;

use crate::format::fixed;

/// A coordinate as people read it, and its unit: angles in degrees.
pub(crate) fn shown(x: f64, unit: &str) -> [String; 2] {
    if unit == "rad" { [fixed(x.to_degrees(), 2), "deg".to_string()] } else { [fixed(x, 4), unit.to_string()] }
}

/// A pose of a scan by its scanned coordinates.
pub(crate) fn pose(scan: &Scan, slice: usize, cell: usize) -> String {
    let values = scan.values(slice, cell);
    let one = |i: usize| {
        let [value, unit] = shown(values[i], scan.units[i]);
        format!("{} = {value} {unit}", scan.names[i])
    };
    scan.axes().map(|a| one(a.index)).collect::<Vec<_>>().join(", ")
}
