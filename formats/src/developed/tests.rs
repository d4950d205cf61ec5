use super::*;
use pipeline::geometry::Rect;

fn samples(size: Size, channels: usize, depth: u32) -> Vec<u16> {
    let mut state = 7u32;
    (0..size.pixels() * channels)
        .map(|k| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            // Smooth and noisy parts.
            let value = if k % 1000 < 500 { k as u32 / 7 } else { state >> 16 };
            (value % (1 << depth)) as u16
        })
        .collect()
}

fn cases() -> impl Iterator<Item = (Size, usize, u32, bool)> {
    let sizes = [Size::new(1, 1), Size::new(16, 5), Size::new(131, 77), Size::new(70, 3000)];
    sizes.into_iter().flat_map(|size| {
        [(3, 8, false), (1, 8, true), (3, 16, true), (1, 16, false)].map(|(c, d, l)| (size, c, d, l))
    })
}

fn part<T: Copy>(all: &[T], size: Size, channels: usize, rows: Range<usize>) -> Vec<T> {
    all[rows.start * size.width * channels..rows.end * size.width * channels].to_vec()
}

#[test]
fn png_and_tiff_of_any_threads_are_decoded_to_their_samples() {
    let folder = tempfile::tempdir().unwrap();
    for (size, channels, depth, linear) in cases() {
        let all = samples(size, channels, depth);
        let mut files = Vec::new();
        for threads in [1, 3] {
            for format in ["png", "tif"] {
                let path = folder.path().join(format!("a{threads}.{format}"));
                let picture = Developed {
                    path: &path,
                    size,
                    channels,
                    depth,
                    linear,
                    comment: "µ test",
                    rows: 32,
                    threads,
                };
                let make = |rows| Ok::<_, ExportError>(part(&all, size, channels, rows));
                match format {
                    "png" => write_png(&picture, &|_, _| (), make).unwrap(),
                    _ => write_tiff(&picture, &|_, _| (), make).unwrap(),
                }
                files.push(std::fs::read(&path).unwrap());
            }
        }
        assert!(files[0] == files[2] && files[1] == files[3]);
        let mut reader = ::png::Decoder::new(std::io::Cursor::new(&files[0])).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        let info = reader.info();
        assert_eq!((info.width as usize, info.height as usize), (size.width, size.height));
        let decoded: Vec<u16> = match depth {
            8 => bytes.iter().map(|b| u16::from(*b)).collect(),
            _ => bytes.as_chunks().0.iter().map(|b| u16::from_be_bytes(*b)).collect(),
        };
        assert!(decoded == all, "{size} {channels} {depth}");
        let mut decoder = ::tiff::decoder::Decoder::new(std::io::Cursor::new(&files[1])).unwrap();
        let decoded: Vec<u16> = match decoder.read_image().unwrap() {
            ::tiff::decoder::DecodingResult::U8(v) => v.into_iter().map(u16::from).collect(),
            ::tiff::decoder::DecodingResult::U16(v) => v,
            _ => panic!("unexpected samples"),
        };
        assert!(decoded == all, "{size} {channels} {depth}");
    }
}

#[test]
fn exr_has_the_linear_values() {
    let folder = tempfile::tempdir().unwrap();
    for (size, channels) in [(Size::new(1, 1), 3), (Size::new(53, 40), 3), (Size::new(33, 9), 1)] {
        let path = folder.path().join("a.exr");
        let all: Vec<f32> = (0..size.pixels() * channels).map(|k| k as f32 * 0.37 - 5.0).collect();
        let picture = Developed {
            path: &path,
            size,
            channels,
            depth: 16,
            linear: true,
            comment: "",
            rows: 32,
            threads: 2,
        };
        write_exr(&picture, &|_, _| (), |rows| Ok::<_, ExportError>(part(&all, size, channels, rows)))
            .unwrap();
        let image = ::exr::prelude::read_all_flat_layers_from_file(&path).unwrap();
        let layer = &image.layer_data[0];
        assert_eq!((layer.size.0, layer.size.1), (size.width, size.height));
        for (c, channel) in layer.channel_data.list.iter().enumerate() {
            let values: Vec<f32> = channel.sample_data.values_as_f32().collect();
            let expected: Vec<f32> = all.iter().skip(channels - 1 - c).step_by(channels).copied().collect();
            assert!(values == expected, "{}", channel.name);
        }
    }
}

#[test]
fn error_of_the_samples_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let rect = Rect::new(0, 0, 100, 10);
    let picture = Developed {
        path: &path,
        size: rect.size(),
        channels: 1,
        depth: 8,
        linear: false,
        comment: "",
        rows: 16,
        threads: 2,
    };
    let make = |rows: Range<usize>| match rows.start {
        32 => Err(ExportError::Read { band: 0, rect, source: "broken".into() }),
        _ => Ok(vec![0; rows.len() * 10]),
    };
    assert!(write_png(&picture, &|_, _| (), make).unwrap_err().to_string().contains("broken"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
