//! MAT-files have the bytes of the format.

use super::*;

fn written(name: &str, value: &MatValue) -> Vec<u8> {
    let mut out = Vec::new();
    file(&mut out, name, value).unwrap();
    out
}

#[test]
fn numbers_and_texts_are_elements_of_the_format() {
    let bytes = written("a", &MatValue::Floats { shape: vec![2, 1], values: vec![1.0, -0.5] });
    assert!(bytes.starts_with(b"MATLAB 5.0 MAT-file, ") && bytes[124..128] == *b"\x00\x01IM");
    let words: Vec<u32> = bytes[HEADER..].as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect();
    // Array of 72 bytes; flags; dimensions; name; two doubles.
    assert_eq!(words[..10], [MATRIX, 72, UINT32, 8, DOUBLE_CLASS, 0, INT32, 8, 2, 1]);
    assert_eq!(words[10..], [INT8, 1, u32::from(b'a'), 0, DOUBLE, 16, 0, 0x3ff0_0000, 0, 0xbfe0_0000]);
    let bytes = written("t", &MatValue::Text("xy".into()));
    assert_eq!(bytes[bytes.len() - 16..], *b"\x04\0\0\0\x04\0\0\0x\0y\0\0\0\0\0");
}

#[test]
fn sizes_of_structs_are_those_of_their_bytes() {
    let inner =
        MatValue::Struct(vec![("name", MatValue::Text("Lens".into())), ("empty", MatValue::column(&[]))]);
    let value = MatValue::Struct(vec![("f", MatValue::number(2.8)), ("inner", inner)]);
    let bytes = written("optics", &value);
    let size = u32::from_le_bytes(*bytes[HEADER + 4..].first_chunk().unwrap()) as usize;
    assert_eq!((size + HEADER + 8, bytes.len() % 8), (bytes.len(), 0));
    let at = |name: &[u8]| bytes.windows(name.len()).position(|w| w == name).unwrap();
    assert_eq!(at(b"inner\0") - at(b"f\0\0"), 32);
}
