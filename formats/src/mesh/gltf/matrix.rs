//! Matrices of nodes (glTF 2.0, 3.5.3), in f64.
//!
//! M = T·R·S, or the given matrix, whose numbers are by columns in the file. The matrix of a node in the world is that of its parent times its
//! own. Rows here; a column vector (x, y, z, 1) is multiplied from the right. The quaternion (x, y, z, w) is made of unit length.

use super::super::context::Context;
use super::super::error::MeshError;
use super::json::Node;

/// A matrix by rows.
pub(super) type Matrix = [[f64; 4]; 4];

/// No transformation.
pub(super) const IDENTITY: Matrix =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
/// Deviation of a quaternion from unit length that is more than rounding of few digits.
const QUATERNION_TOLERANCE: f64 = 1e-2;

/// a·b of affine matrices. Sums in the order of the columns.
pub(super) fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|r| {
        std::array::from_fn(|c| {
            ((a[r][0] * b[0][c] + a[r][1] * b[1][c]) + a[r][2] * b[2][c]) + a[r][3] * b[3][c]
        })
    })
}

/// Matrix of a node in its parent.
///
/// # Errors
/// A matrix that is not affine, a rotation by a quaternion of length 0.
pub(super) fn of_node(context: &Context<'_>, number: usize, node: &Node) -> Result<Matrix, MeshError> {
    if let Some(m) = &node.matrix {
        if node.translation.is_some() || node.rotation.is_some() || node.scale.is_some() {
            context.note("translation, rotation and scale of nodes with a matrix are ignored");
        }
        let matrix: Matrix = std::array::from_fn(|r| std::array::from_fn(|c| m[4 * c + r]));
        return match matrix[3] == [0.0, 0.0, 0.0, 1.0] {
            true => Ok(matrix),
            false => Err(context.invalid(
                format!("nodes[{number}].matrix"),
                "last row 0, 0, 0, 1",
                format!("{:?}", matrix[3]),
            )),
        };
    }
    let [tx, ty, tz] = node.translation.unwrap_or_default();
    let [sx, sy, sz] = node.scale.unwrap_or([1.0; 3]);
    let [x, y, z, w] = unit(context, number, node.rotation)?;
    let rotation = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let row = |r: usize, t: f64| [rotation[r][0] * sx, rotation[r][1] * sy, rotation[r][2] * sz, t];
    Ok([row(0, tx), row(1, ty), row(2, tz), IDENTITY[3]])
}

fn unit(context: &Context<'_>, number: usize, rotation: Option<[f64; 4]>) -> Result<[f64; 4], MeshError> {
    let Some(q) = rotation else {
        return Ok([0.0, 0.0, 0.0, 1.0]);
    };
    let length = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    if !(length > 0.0 && length.is_finite()) {
        let place = format!("nodes[{number}].rotation");
        return Err(context.invalid(place, "a unit quaternion", format!("{q:?}")));
    }
    if (length - 1.0).abs() > QUATERNION_TOLERANCE {
        context.note("rotations of a length other than 1 are normalised");
    }
    Ok(q.map(|c| c / length))
}
