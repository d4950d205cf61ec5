//! Slabs: the intervals of vergence between neighbouring depth nodes.
//!
//! ```text
//! slab s = [V_s, V_s+1), the last one closed; slab 0 is the farthest. A lens with one node has one slab.
//! t = (V − V_s)/(V_s+1 − V_s)            position of a surface in its slab
//! ```
//! Two slabs are *apart* if another slab lies between them and their vergences differ by at least
//! ```text
//! max(2 px, a quarter of the farther one's blur)/blur per dioptre;
//! ```
//! otherwise they may belong to one surface.

/// A depth edge: blur radii that differ by more than this, px.
const EDGE_PX: f64 = 2.0;
/// And by more than this share of the farther one's blur.
const EDGE_SHARE: f64 = 0.25;

/// Slabs of one band.
#[derive(Clone, Debug, PartialEq)]
pub struct Slabs {
    /// Vergences of the nodes, 1/m, ascending.
    vergence: Vec<f64>,
    /// Vergence in focus, 1/m.
    focus: f64,
    /// Blur radius per dioptre, film px.
    blur_px: f64,
}

impl Slabs {
    /// Between nodes at `vergence` (1/m, ascending) of a lens focused at `focus`, with a blur radius of `blur_px` film pixels per dioptre.
    pub fn new(vergence: &[f64], focus: f64, blur_px: f64) -> Self {
        Self { vergence: vergence.to_vec(), focus, blur_px }
    }

    /// Number of slabs.
    pub fn count(&self) -> usize {
        (self.vergence.len() - 1).max(1)
    }

    /// Vergences of the nodes, 1/m.
    pub fn vergence(&self) -> &[f64] {
        &self.vergence
    }

    /// The nodes below and above slab `s`: (farther, nearer).
    pub fn nodes(&self, s: usize) -> (usize, usize) {
        (s, (s + 1).min(self.vergence.len() - 1))
    }

    /// Vergences of the nodes below and above slab `s`, 1/m.
    pub fn ends(&self, s: usize) -> (f64, f64) {
        let (low, high) = self.nodes(s);
        (self.vergence[low], self.vergence[high])
    }

    /// The slab of vergence `v`, or the one nearest to it.
    pub fn of(&self, v: f64) -> usize {
        let above = self.vergence.partition_point(|node| *node <= v);
        above.saturating_sub(1).min(self.count() - 1)
    }

    /// Position t of vergence `v` in slab `s`, 0 to 1.
    pub fn position(&self, s: usize, v: f64) -> f64 {
        let (low, high) = self.ends(s);
        if high > low { ((v - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Whether slabs `far` < `near` are apart.
    pub fn apart(&self, far: usize, near: usize) -> bool {
        let top = self.vergence[self.nodes(far).1];
        let gap = (EDGE_PX / self.blur_px).max(EDGE_SHARE * (top - self.focus).abs());
        near > far + 1 && self.vergence[near] - top >= gap
    }

    /// Blur radius of vergence `v`, film px, positive for what is nearer than the focus.
    pub fn blur_at(&self, v: f64) -> f64 {
        self.blur_px * (v - self.focus)
    }

    /// The larger blur radius at the ends of slab `s`, film px.
    pub fn blur_px(&self, s: usize) -> f64 {
        let (low, high) = self.ends(s);
        self.blur_at(low).abs().max(self.blur_at(high).abs())
    }

    /// The node of slab `s` that is farther from focus, whose kernels are wider.
    pub fn wide(&self, s: usize) -> usize {
        let (low, high) = self.nodes(s);
        let blur = |d: usize| (self.vergence[d] - self.focus).abs();
        if blur(high) > blur(low) { high } else { low }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slabs_are_half_open_and_the_last_one_closed() {
        let slabs = Slabs::new(&[0.0, 0.5, 2.0], 0.5, 10.0);
        assert_eq!([-1.0, 0.0, 0.49, 0.5, 1.9, 2.0, 3.0].map(|v| slabs.of(v)), [0, 0, 0, 1, 1, 1, 1]);
        assert_eq!(slabs.position(1, 1.25), 0.5);
        assert_eq!((slabs.wide(0), slabs.wide(1)), (0, 2));
        let one = Slabs::new(&[0.7], 0.5, 10.0);
        assert_eq!((one.count(), one.nodes(0), one.of(0.9), one.position(0, 0.9)), (1, (0, 0), 0, 0.0));
    }

    #[test]
    fn neighbouring_slabs_are_never_apart() {
        let slabs = Slabs::new(&[0.0, 0.1, 0.2, 1.0, 1.5], 0.2, 100.0);
        assert!(!slabs.apart(0, 1) && slabs.apart(0, 2) && !slabs.apart(1, 2) && slabs.apart(1, 3));
        // Blur at the top of slab 2: 80 px; a quarter of it is 20 px, the distance to slab 4 would be 50 px.
        assert!(!slabs.apart(2, 3));
    }
}
