#![cfg(feature = "design")]
use nalgebra::Complex;
use pkm_ctrl::design::mu::*;
fn m(rows: &[&[(f64,f64)]]) -> CMatrix { CMatrix::from_fn(rows.len(), rows[0].len(), |i,j| Complex::new(rows[i][j].0, rows[i][j].1)) }
#[test]
fn try_it() {
    let a = m(&[&[(2.,0.),(2.,0.)],&[(-1.,0.),(-1.,0.)]]);
    for s in [vec![Block::Full{rows:2,cols:2}], vec![Block::Complex{repeats:1};2], vec![Block::Real{repeats:1};2]] {
        let s = Structure::try_new(s).unwrap();
        let u = upper_bound(&a,&s).unwrap();
        let l = lower_bound(&a,&s,&u).unwrap();
        println!("lower {} {:?}", l.beta, l.perturbation);
        println!("{:?} {} {:?} {}", s.blocks(), u.certificate.beta, u.status, u.steps);
    }
    let r = [[(-1.,6.),(2.,-3.),(3.,8.),(3.,8.),(-5.,-9.),(-6.,2.)],[(4.,2.),(-2.,5.),(-6.,-7.),(-4.,11.),(8.,-7.),(12.,-1.)],[(5.,-4.),(-4.,-8.),(1.,-3.),(-6.,14.),(2.,-5.),(4.,16.)]];
    let z = CMatrix::from_fn(6,6,|i,j| Complex::new(r[i%3][j].0,r[i%3][j].1));
    let s = Structure::try_new(vec![Block::Real{repeats:1},Block::Real{repeats:1},Block::Full{rows:2,cols:2},Block::Complex{repeats:1},Block::Complex{repeats:1}]).unwrap();
    let u = upper_bound(&z,&s).unwrap();
    println!("slicot {} {:?} {} res {}", u.certificate.beta, u.status, u.steps, u.certificate.residual(&z,&s));
    let mut seed = 1u64;
    let mut rnd = || { seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407); ((seed>>33) as f64)/2f64.powi(31)-0.5 };
    let s = Structure::try_new(vec![Block::Real{repeats:1},Block::Real{repeats:1},Block::Real{repeats:1},Block::Full{rows:3,cols:3},Block::Full{rows:3,cols:3}]).unwrap();
    for _ in 0..20 {
        let a = CMatrix::from_fn(9,9,|_,_| Complex::new(rnd(),rnd()));
        let t=std::time::Instant::now();
        let u = upper_bound(&a,&s).unwrap();
        let t2=std::time::Instant::now();
        let l = lower_bound(&a,&s,&u).unwrap();
        println!("ratio {} {:?}", l.beta/u.certificate.beta, t2.elapsed());
        println!("rand {} {:?} {} {:?}", u.certificate.beta, u.status, u.steps, t.elapsed());
    }
}
#[test]
fn small_real() {
    let a = m(&[&[(2.,0.),(2.,0.)],&[(-1.,0.),(-1.,0.)]]);
    let s = Structure::try_new(vec![Block::Real{repeats:1};2]).unwrap();
    let u = upper_bound(&a,&s).unwrap();
    println!("lower {:?}", lower_bound(&a,&s,&u).unwrap());
}
