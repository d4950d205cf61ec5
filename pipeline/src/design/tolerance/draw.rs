//! The uniform number of an error: a pure function of seed, sample and the error's identifier.
//!
//!   u = (⌊m / 2¹¹⌋ + ½) / 2⁵³,   m = mix(mix(mix(seed) ⊕ sample) ⊕ FNV-1a(id))
//!
//! mix is the finaliser of SplitMix64 with its increment. Neither the number of lenses nor the order or number of other errors
//! matters: lens 7 of 8 is lens 7 of 1000. The largest of the 2⁵³ values rounds to u = 1, all others lie in (0, 1).
//! Sources: Steele, Lea, Flood, "Fast splittable pseudorandom number generators" (OOPSLA 2014), with Stafford's constants; Fowler,
//! Noll, Vo, hash FNV-1a with 64 bits.

/// The uniform number of the error `id` of a sample.
pub fn uniform(seed: u64, sample: u64, id: &str) -> f64 {
    let bits = mix(mix(mix(seed) ^ sample) ^ fnv1a(id)) >> 11;
    (bits as f64 + 0.5) / (1u64 << 53) as f64
}

fn mix(z: u64) -> u64 {
    let z = z.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

fn fnv1a(text: &str) -> u64 {
    text.bytes().fold(0xCBF2_9CE4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3)
    })
}

#[cfg(test)]
mod tests {
    use super::uniform;

    /// `uniform(seed, sample, id)` of fields_reference.py (Python 3.11), bit for bit.
    const GOLDEN: [(u64, u64, &str, f64); 20] = [
        (1, 0, "element 7-9/decentre_x", 0.2958606941195819),
        (1, 7, "gap 3/thickness", 0.3818843987044301),
        (u64::MAX, 1 << 40, "film/tilt_y", 0.22196184509533928),
        (0, 0, "x", 0.9241302282958097),
        (7, 0, "x", 0.3261451239912599),
        (7, 19999, "x", 0.819497725109829),
        (1, 1, "element 7-9/decentre_x", 0.5348180593409451),
        (1, 0, "element 7-9/decentre_y", 0.7193038003661696),
        (1, 0, "element 3/decentre_x", 0.2183186634669005),
        (2, 0, "element 3/decentre_x", 0.9492638951483938),
        (42, 123_456_789, "surface 5/radius", 0.3408164712511545),
        (42, 123_456_789, "surface 5/irregularity", 0.38097796158542513),
        (42, 123_456_789, "surface 5/irregularity_angle", 0.6583496716274961),
        (3, 2, "glass 3/index", 0.0931296804593083),
        (3, 2, "glass 3/abbe", 0.9785146513850156),
        (1, 7, "gap 3/thickness#2", 0.38709522056068585),
        (1 << 63, 1 << 63, "element 1-12/tilt_x", 0.3496706062210542),
        (1, u64::MAX, "element 1-12/tilt_y", 0.4164420830630993),
        (12345, 999, "surface 12/zernike_11", 0.6441623428473682),
        (5, 5, "film/shift", 0.31879453049355394),
    ];

    #[test]
    fn uniform_numbers_are_those_of_the_reference() {
        for (seed, sample, id, expected) in GOLDEN {
            assert_eq!(uniform(seed, sample, id).to_bits(), expected.to_bits(), "{seed} {sample} {id}");
        }
    }

    /// Of 10⁵ numbers the mean is ½ within four of its deviations, 1/√(12 · 10⁵), and the variance 1/12 within 1 %.
    #[test]
    fn numbers_are_uniform() {
        let n = 100_000;
        let u: Vec<f64> = (0..n).map(|k| uniform(7, k, "x")).collect();
        let mean = u.iter().sum::<f64>() / n as f64;
        let variance = u.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n as f64;
        assert!((mean - 0.5).abs() < 4.0 / (12.0 * n as f64).sqrt(), "{mean}");
        assert!((variance * 12.0 - 1.0).abs() < 0.01, "{variance}");
        assert!(u.iter().all(|v| *v > 0.0 && *v < 1.0));
    }
}
