//! Vertices at one place: the same three f32 values.

use crate::scratch::{List, Scratch, ScratchError};

/// Empty slot of the table.
const EMPTY: u32 = u32::MAX;

/// For each vertex the first one at its place. Vertices are finite and hold no −0.
///
/// A table of 4 B slots with linear probing, at most half full.
pub(super) fn weld(vertices: &[[f32; 3]], scratch: &Scratch) -> Result<List<u32>, ScratchError> {
    let slots = (2 * vertices.len()).next_power_of_two().max(2);
    let mut list = scratch.list(slots)?;
    list.resize(slots, EMPTY);
    let table = &mut list[..];
    let mask = slots - 1;
    let mut first = scratch.list(vertices.len())?;
    for (i, v) in vertices.iter().enumerate() {
        let mut slot = hash(v) as usize & mask;
        first.push(loop {
            match table[slot] {
                EMPTY => {
                    table[slot] = i as u32;
                    break i as u32;
                }
                other if vertices[other as usize] == *v => break other,
                _ => slot = (slot + 1) & mask,
            }
        });
    }
    Ok(first)
}

/// Mixes all bits of the coordinates (the finaliser of `SplitMix64`, twice).
fn hash(v: &[f32; 3]) -> u64 {
    let [x, y, z] = v.map(|c| u64::from(c.to_bits()));
    mix(mix(x << 32 | y).wrapping_add(z))
}

fn mix(mut h: u64) -> u64 {
    h = h.wrapping_add(0x9e37_79b9_7f4a_7c15);
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    h ^ (h >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_at_one_place_are_one() {
        let places: Vec<[f32; 3]> =
            (0..3000).map(|i: i32| [(i % 10) as f32, (i / 10 % 10) as f32, -(i % 3) as f32 + 0.0]).collect();
        let first = weld(&places, &Scratch::default()).unwrap();
        for (i, &f) in first.iter().enumerate() {
            assert_eq!(places[f as usize], places[i]);
            assert_eq!(places.iter().position(|p| *p == places[i]), Some(f as usize));
        }
    }
}
