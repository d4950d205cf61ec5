//! The compiled kernels; `scripts/ptx` makes them: PTX, which the driver assembles for any GPU, and cubins, which GPUs of some architectures load as
//! they are.

/// The kernels of a `.cu` file.
#[derive(Debug)]
pub struct Kernels {
    /// PTX.
    pub ptx: &'static str,
    /// Cubins and their compute capabilities, ascending.
    pub cubins: &'static [((i32, i32), &'static [u8])],
}

/// Bytes aligned as the headers of a cubin.
#[repr(align(16))]
struct Aligned<T: ?Sized>(T);

/// A cubin of `pipeline/ptx`.
macro_rules! cubin {
    ($name:literal, $architecture:literal) => {{
        const CUBIN: &Aligned<[u8]> = &Aligned(*include_bytes!(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/ptx/",
            $name,
            ".sm_",
            $architecture,
            ".cubin"
        )));
        &CUBIN.0
    }};
}

/// The kernels of `pipeline/ptx/NAME.*`.
macro_rules! kernels {
    ($name:literal) => {
        Kernels {
            ptx: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/ptx/", $name, ".ptx")),
            cubins: &[
                ((8, 0), cubin!($name, 80)),
                ((8, 6), cubin!($name, 86)),
                ((8, 9), cubin!($name, 89)),
                ((9, 0), cubin!($name, 90)),
                ((10, 0), cubin!($name, 100)),
                ((12, 0), cubin!($name, 120)),
            ],
        }
    };
}

/// Remap stage: `remap.cu`.
pub static REMAP: Kernels = kernels!("remap");
/// PSF stage: `psf.cu`.
pub static PSF: Kernels = kernels!("psf");
/// Overlap-add: `overlap_add.cu`.
pub static OVERLAP_ADD: Kernels = kernels!("overlap_add");

impl Kernels {
    /// Kernels that are assembled on every GPU.
    pub const fn of_ptx(ptx: &'static str) -> Self {
        Self { ptx, cubins: &[] }
    }

    /// The cubin that a GPU of compute capability (major, minor) can load: the newest of its major number that is not newer than it.
    pub fn cubin(&self, (major, minor): (i32, i32)) -> Option<&'static [u8]> {
        let newest = self.cubins.iter().rfind(|((m, n), _)| *m == major && *n <= minor);
        newest.map(|&(_, cubin)| cubin)
    }
}

/// The version of the PTX language that `kernels` are written in, e.g. `8.2`, and their oldest target, e.g. `sm_80`.
pub fn version(kernels: &Kernels) -> Option<(&str, &str)> {
    let value = |key: &str| kernels.ptx.lines().find_map(|line| line.strip_prefix(key)).map(str::trim);
    Some((value(".version ")?, value(".target ")?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_has_one_version() {
        assert_eq!(version(&REMAP), Some(("8.2", "sm_80")));
        assert_eq!([version(&PSF), version(&OVERLAP_ADD)], [version(&REMAP); 2]);
        assert_eq!(version(&Kernels::of_ptx("no kernel")), None);
    }

    #[test]
    fn cubin_is_of_the_major_number_and_not_newer_than_the_gpu() {
        let of = |capability| {
            let cubin = PSF.cubin(capability)?;
            PSF.cubins.iter().find(|(_, c)| c.as_ptr() == cubin.as_ptr()).map(|(of, _)| *of)
        };
        let expected =
            [((8, 0), (8, 0)), ((8, 7), (8, 6)), ((9, 0), (9, 0)), ((10, 3), (10, 0)), ((12, 1), (12, 0))];
        for (gpu, cubin) in expected {
            assert_eq!(of(gpu), Some(cubin), "{gpu:?}");
        }
        assert_eq!([of((7, 5)), of((11, 0)), of((13, 0))], [None; 3]);
        for kernels in [&REMAP, &PSF, &OVERLAP_ADD] {
            for (capability, cubin) in kernels.cubins {
                assert!(cubin.starts_with(b"\x7fELF") && cubin.as_ptr().addr() % 16 == 0, "{capability:?}");
            }
        }
    }
}
