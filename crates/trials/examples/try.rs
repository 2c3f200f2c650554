use pkm_trials::case::{Level, Wish, make};
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let n: u64 = args[1].parse().unwrap();
    for i in 1..=n {
        let mut w = Wish::of(i, 1, (&Level::ALL, &[]), &[0.5, 1.0, 2.0, 4.0]);
        if let Some(l) = args.get(2) { w.level = Level::ALL[l.parse::<usize>().unwrap()]; }
        if let Some(e) = args.get(3) { w.effect = Some(e.clone()); }
        if let Some(r) = args.get(4) { w.robot = r.clone(); }
        let t = std::time::Instant::now();
        match make(&w) {
            Ok(c) => {
                println!("{i} {:?} {} size {} {:.1}s: {}", w.level, w.robot, w.size, t.elapsed().as_secs_f64(),
                c.answer.concealed.iter().map(|c| format!("{}@{:?} {:.2} k{:.3} {:?}", c.effect, c.place, c.size.unwrap(), c.beside_refit.unwrap(), c.parameters.iter().map(|p| format!("{}={:.4}({:.4})", p.name, p.value, p.from)).collect::<Vec<_>>())).collect::<Vec<_>>().join("; "));
                println!("    noise {:?}", c.answer.floor);
            }
            Err(e) => println!("{i} {:?} {} {:.1}s ERR {e}", w.level, w.robot, t.elapsed().as_secs_f64()),
        }
    }
}
