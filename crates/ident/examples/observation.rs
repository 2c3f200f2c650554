//! Prints an observation matrix as CSV for `tests/golden/excitation/make_golden.py`.
#![expect(clippy::print_stdout, reason = "its output is what it is for")]

#[path = "../tests/observation/mod.rs"]
mod observation;

fn main() {
    println!("{}", observation::COLUMNS.join(","));
    let w = observation::observation();
    for i in 0..w.nrows() {
        let cells: Vec<String> = (0..w.ncols()).map(|j| format!("{:?}", w[(i, j)])).collect();
        println!("{}", cells.join(","));
    }
}
