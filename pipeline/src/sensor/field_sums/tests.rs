use super::super::lanes::Set;
use super::*;

/// The columns of a row have the sums and terms of one pixel after the other in the order of bands, by any instructions, wherever cells begin and whatever the period of the mosaic.
#[test]
fn vectors_have_the_bits_of_one_pixel_after_the_other() {
    let number = |k: usize| ((k * 2_654_435_761) % 1009) as f64 / 1009.0 - 0.3;
    for (bands, n, cell, period) in
        [(1, 3, 2, 1), (2, 40, 11, 2), (3, 61, 23, 3), (5, 77, 5, 6), (4, 96, 32, 4), (9, 211, 83, 5)]
    {
        let taps: Vec<(usize, [f64; 4])> =
            (0..n).map(|x| (5 + x / cell, std::array::from_fn(|k| number(4 * x + k)))).collect();
        let columns = Columns::new(taps.iter().copied());
        let nodes = columns.nodes();
        assert_eq!(nodes, 5..5 + (n - 1) / cell + 4);
        let value = |band: usize, column: usize, node: usize| number(37 * band + 11 * column + 5 * node + 3);
        let uniform = |band: usize, column: usize| number(17 * band + 3 * column);
        let mut row = RowNodes { nodes: nodes.clone(), ..RowNodes::default() };
        row.period = (1..9).find(|k| (k * VECTOR).is_multiple_of(period)).unwrap();
        for (band, vector) in (0..bands).flat_map(|band| (0..row.period).map(move |vector| (band, vector))) {
            let column = |lane: usize| (vector * VECTOR + lane) % period;
            row.uniform.push(std::array::from_fn(|lane| uniform(band, column(lane))));
            row.values.extend(
                nodes.clone().map(|node| std::array::from_fn(|lane| value(band, column(lane), node))),
            );
        }
        let lines: Vec<Vec<f32>> =
            (0..bands).map(|b| (0..n).map(|i| number(b * n + i) as f32).collect()).collect();
        let lines: Vec<&[f32]> = lines.iter().map(Vec::as_slice).collect();
        let start: Vec<f64> = (0..n).map(number).collect();
        let (mut sums, mut terms) = (start.clone(), vec![0.0f32; bands * n]);
        for (band, line) in lines.iter().enumerate() {
            for (x, (first, [a, b, c, d])) in taps.iter().enumerate() {
                let v = |k: usize| value(band, x % period, first + k);
                let weight = uniform(band, x % period) + ((a * v(0) + b * v(1)) + (c * v(2) + d * v(3)));
                let term = weight * f64::from(line[x]);
                sums[x] += term;
                terms[band * n + x] = term as f32;
            }
        }
        for set in Set::available() {
            let (mut found, mut of_bands, mut alone) = (start.clone(), vec![0.0; bands * n], start.clone());
            set.run(
                #[inline(always)]
                || {
                    columns.add(&row, &lines, &mut found, &mut of_bands);
                    columns.add(&row, &lines, &mut alone, &mut []);
                },
            );
            assert!(found == sums && alone == sums && of_bands == terms, "{bands} {n} {period} {set:?}");
        }
    }
}
