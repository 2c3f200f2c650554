//! Several topics on one time axis.

/// Half the median period of increasing times `[ns]`; 0 with fewer than two.
pub(super) fn half_period(times: &[i64]) -> u64 {
    let mut periods: Vec<u64> = times.windows(2).map(|w| w[1].abs_diff(w[0])).collect();
    let middle = periods.len() / 2;
    if periods.is_empty() {
        return 0;
    }
    let (_, median, _) = periods.select_nth_unstable(middle);
    *median / 2
}

/// For each time of `base` the row of the nearest message no farther away than `reach` `[ns]`.
///
/// Both are increasing. An equal time is always the nearest; of two equally near the earlier is taken.
pub(super) fn nearest(base: &[i64], rows: &[(i64, usize)], reach: u64) -> Vec<Option<usize>> {
    let mut next = 0;
    base.iter()
        .map(|t| {
            while rows.get(next).is_some_and(|(time, _)| time < t) {
                next += 1;
            }
            let before = next.checked_sub(1).and_then(|k| rows.get(k));
            let (time, row) = [before, rows.get(next)].into_iter().flatten().min_by_key(|(time, _)| time.abs_diff(*t))?;
            (time.abs_diff(*t) <= reach).then_some(*row)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_within_half_a_period() {
        let base = [0, 10, 20, 30, 40];
        assert_eq!(half_period(&base), 5);
        let rows = [(1, 7), (10, 8), (26, 9), (100, 1)];
        assert_eq!(nearest(&base, &rows, 5), [Some(7), Some(8), None, Some(9), None]);
        assert_eq!(nearest(&base, &[], 5), [None; 5]);
        assert_eq!(half_period(&[3]), 0);
    }
}
