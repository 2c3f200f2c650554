//! Long recordings at the rate that their band needs.
//!
//! Efforts are compared below the band. A recording at 1 kHz in a band of 5 Hz is two hundred samples per period: beyond some minutes all that
//! these cost is time and memory. Taken is then every few samples of what positions and efforts are below ten times less than the new rate, so
//! nothing folds back. In the band that low-pass leaves all but three parts in a million, and averages noise as it did. What is lost is
//! where between two of these samples a direction changes, and there every fit leaves the rows of that joint out ([`crate::rows`]).

use pkm_ident::filter::LowPass;

use crate::segment::Segment;
use crate::settings::{LONG, RATE};

/// Brings the segments of a diagnosis that are long altogether to the rate that their band needs; says so, one line per recording.
pub(crate) fn thin(segments: Vec<Segment>) -> (Vec<Segment>, Vec<String>) {
    if segments.iter().map(|s| s.valid.len()).sum::<usize>() <= LONG {
        return (segments, Vec::new());
    }
    let mut notes = Vec::new();
    let thinned = segments.into_iter().map(|s| {
        let every = every(&s);
        if every < 2 {
            return s;
        }
        notes.push(format!(
            "{}: {} samples are many for a band of {:.3} Hz: taken at {:.1} Hz instead of {:.1} Hz, behind a low-pass of {:.1} Hz",
            s.name,
            s.valid.len(),
            s.band,
            1.0 / (s.dt * every as f64),
            1.0 / s.dt,
            SMOOTH * s.band
        ));
        of(s, every)
    });
    (thinned.collect(), notes)
}

/// Positions of a segment are below this many bands already ([`crate::segment`]).
const SMOOTH: f64 = 5.0;

fn every(s: &Segment) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a ratio of two positive rates")]
    let every = (1.0 / (s.dt * RATE * s.band)).floor() as usize;
    every.max(1)
}

/// Every so many samples of a segment; what was not smoothed yet is, just as positions were.
fn of(s: Segment, every: usize) -> Segment {
    let filter = LowPass::new(SMOOTH * s.band, s.dt);
    let pick = |x: &[f64]| -> Vec<f64> { x.iter().step_by(every).copied().collect() };
    let picked = |all: &[Vec<f64>]| -> Vec<Vec<f64>> { all.iter().map(|x| pick(x)).collect() };
    let smooth = |x: &[f64]| pick(&filter.apply(x));
    let mut wrenches = s.wrenches;
    wrenches.iter_mut().flat_map(|w| &mut w.components).for_each(|x| *x = smooth(x));
    Segment {
        dt: s.dt * every as f64,
        q: picked(&s.q),
        v: picked(&s.v),
        a: picked(&s.a),
        tau: s.tau.iter().map(|x| smooth(x)).collect(),
        warmth: picked(&s.warmth),
        extra: s.extra.iter().map(|(name, x)| (name.clone(), pick(x))).collect(),
        // A sample that was missing is in its neighbours by now.
        valid: s.valid.chunks(every).map(|part| part.iter().all(|ok| *ok)).collect(),
        channels: s.channels.iter().map(|(kind, x)| (*kind, x.as_ref().map(|x| smooth(x)))).collect(),
        wrenches,
        ..s
    }
}
