//! Linear least squares of a few unknowns: the x that minimises |A x − b|² by A = Q R, without the squared condition of normal equations.

/// Length of what is left of a column without the columns before it, over its length, below which it depends on them.
const LEAST_LEFT: f64 = 1e-9;

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    std::iter::zip(a, b).map(|(a, b)| a * b).sum()
}

/// Columns as Q·R, by modified Gram-Schmidt, each column orthogonalised twice.
pub(crate) struct Qr {
    q: Vec<Vec<f64>>,
    /// Column by column, upper part.
    r: Vec<Vec<f64>>,
}

impl Qr {
    /// `None` if the columns depend on each other.
    pub(crate) fn new(columns: Vec<Vec<f64>>) -> Option<Self> {
        let (mut q, mut r): (Vec<Vec<f64>>, Vec<Vec<f64>>) = (Vec::new(), Vec::new());
        for mut column in columns {
            let before = dot(&column, &column).sqrt();
            let mut shares = vec![0.0; q.len() + 1];
            for _ in 0..2 {
                for (i, own) in q.iter().enumerate() {
                    let share = dot(own, &column);
                    shares[i] += share;
                    std::iter::zip(&mut column, own).for_each(|(v, o)| *v -= share * o);
                }
            }
            let length = dot(&column, &column).sqrt();
            if length.is_nan() || length <= LEAST_LEFT * before || before == 0.0 {
                return None;
            }
            shares[q.len()] = length;
            q.push(column.into_iter().map(|v| v / length).collect());
            r.push(shares);
        }
        Some(Self { q, r })
    }

    /// The unknowns for the right side b, one a column.
    pub(crate) fn solve(&self, right: &[f64]) -> Vec<f64> {
        let mut x: Vec<f64> = self.q.iter().map(|q| dot(q, right)).collect();
        for k in (0..x.len()).rev() {
            x[k] /= self.r[k][k];
            let value = x[k];
            for (i, r) in self.r[k][..k].iter().enumerate() {
                x[i] -= r * value;
            }
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_squares_recovers_coefficients() {
        let columns = vec![vec![1.0, 2.0, 3.0, 4.0], vec![1.0, -1.0, 1.0, -1.0]];
        let right: Vec<f64> = (0..4).map(|i| 3.0 * columns[0][i] - 0.5 * columns[1][i]).collect();
        let x = Qr::new(columns).unwrap().solve(&right);
        assert!((x[0] - 3.0).abs() < 1e-14 && (x[1] + 0.5).abs() < 1e-14);
        assert!(Qr::new(vec![vec![1.0, 2.0], vec![2.0, 4.0]]).is_none());
        assert!(Qr::new(Vec::new()).unwrap().solve(&[1.0]).is_empty());
    }
}
