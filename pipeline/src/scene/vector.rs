//! Vectors of three components in f64.

/// a·b.
pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

/// a × b. Of f32 values it has one rounding a component, and cross(b, a) = −cross(a, b).
#[inline(always)]
pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// a − b.
pub(super) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Length of a.
pub(super) fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// The vector times a factor.
pub(super) fn scaled(v: [f64; 3], factor: f64) -> [f64; 3] {
    v.map(|v| v * factor)
}

/// The unit vector; `None` for one without direction.
pub(super) fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = length(v);
    (length > 0.0 && length.is_finite()).then(|| v.map(|v| v / length))
}
