//! A scan as CSV and as JSON, SI units.

use core::fmt::Write;

use pkm_dyn::Model;
use pkm_dyn::workspace::{Axis, Cause, Cell, Cone, Scan};
use serde_json::{Map, Value, json};

/// One line per cell: prescribed coordinates `[m | rad]`, cause, place, singular values, condition number. Empty fields: no such pose.
pub(super) fn csv(scan: &Scan, model: &Model, cones: &[Cone]) -> String {
    let mut out = scan.names.join(",") + ",cause,place,parallel,serial,condition\n";
    for (slice, i, cell) in scan.cells() {
        for x in scan.values(slice, i) {
            let _ = write!(out, "{x},");
        }
        let _ = write!(out, "{},{}", Cause::NAMES[cell.cause.kind()], quoted(cell.cause.place(model, cones)));
        for x in [cell.parallel, cell.serial, cell.condition] {
            let _ = if x.is_finite() { write!(out, ",{x}") } else { write!(out, ",") };
        }
        out.push('\n');
    }
    out
}

/// A name as a CSV field.
fn quoted(name: &str) -> String {
    if name.contains(['"', ',', '\n', '\r']) { format!("\"{}\"", name.replace('"', "\"\"")) } else { name.to_string() }
}

/// The scan; numbers that are not finite are null.
pub(super) fn json(scan: &Scan, model: &Model, cones: &[Cone]) -> Value {
    let [reachable, all] = scan.reachable();
    let of = |values: &[f64]| -> Value { scan.names.iter().cloned().zip(values.iter().map(|x| json!(x))).collect::<Map<_, _>>().into() };
    let numbers =
        |c: &Cell| json!({"parallel": c.parallel, "serial": c.serial, "condition": c.condition, "cause": Cause::NAMES[c.cause.kind()]});
    let axis = |a: &Axis| json!({"name": scan.names[a.index], "unit": scan.units[a.index], "values": a.values});
    let causes: Vec<Value> = scan
        .causes()
        .into_iter()
        .map(|(c, n)| json!({"cause": Cause::NAMES[c.kind()], "place": c.place(model, cones), "poses": n}))
        .collect();
    let extents: Map<String, Value> =
        scan.extents().into_iter().flatten().zip(scan.axes()).map(|(e, a)| (scan.names[a.index].clone(), json!(e))).collect();
    let worst = scan.worst().map(|(s, i, c)| {
        let mut value = numbers(c);
        value["at"] = of(&scan.values(s, i));
        value
    });
    let slices: Vec<Value> = scan
        .slices
        .iter()
        .map(|s| {
            let column = |of: fn(&Cell) -> f64| s.cells.iter().map(of).collect::<Vec<f64>>();
            json!({
                "at": of(&s.at),
                "cause": s.cells.iter().map(|c| c.cause.kind()).collect::<Vec<_>>(),
                "parallel": column(|c| c.parallel),
                "serial": column(|c| c.serial),
                "condition": column(|c| c.condition),
            })
        })
        .collect();
    json!({
        "schema": "pkm.workspace/1",
        "robot": model.name,
        "output": scan.output,
        "length_m": scan.length,
        "coordinates": scan.names,
        "units": scan.units,
        "home": {"at": of(&scan.home_values), "parallel": scan.home.parallel, "serial": scan.home.serial, "condition": scan.home.condition},
        "axes": scan.axes().map(axis).collect::<Vec<_>>(),
        "poses": all,
        "reachable": reachable,
        "extents": extents,
        "limits": causes,
        "worst": worst,
        "causes": Cause::NAMES,
        "slices": slices,
    })
}
