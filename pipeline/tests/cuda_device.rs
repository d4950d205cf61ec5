//! Opening GPUs and what can go wrong, over the emulated driver; and that driver itself: what it runs and what it catches.

#![allow(unsafe_code, reason = "kernels are launched by hand")]

mod emulated_cuda;

use emulated_cuda::{Build, Case, On, PLAIN, WATCHED};
use lenscube_pipeline::cuda::handle::CudaStream;
use lenscube_pipeline::cuda::launch::LaunchConfig;
use lenscube_pipeline::cuda::slice::CudaSlice;
use lenscube_pipeline::cuda::{CudaError, Device, devices};
use std::process::ExitCode;
use std::sync::Arc;

const PROBE: &str = include_str!("emulated_cuda/probe.ptx");

fn scale(
    device: &Device,
    stream: &Arc<CudaStream>,
    from: &CudaSlice<f32>,
    to: &mut CudaSlice<f32>,
    (a, b): (f32, f32),
) -> Result<(), CudaError> {
    let kernel = device.kernel(PROBE, "probe_scale")?;
    let n = from.len() as u32;
    let shape = LaunchConfig { grid_dim: (n.div_ceil(64), 1, 1), block_dim: (64, 1, 1), shared_mem_bytes: 0 };
    // SAFETY: the arguments are the kernel's, and both slices hold n values.
    unsafe { stream.launch_builder(&kernel).arg(from).arg(to).arg(&n).arg(&a).arg(&b).launch(shape) }
        .map_err(device.failed("scaling"))?;
    Ok(())
}

/// Up, twice through a kernel on another stream, down; explicit events only where `waits`.
fn chain(waits: bool) -> Vec<f32> {
    let device = Device::open(0).unwrap();
    let context = &device.context;
    let [up, compute, down] = [(); 3].map(|()| context.new_stream().unwrap());
    let n = 1000;
    let mut source = context.alloc_pinned::<f32>(n).unwrap();
    let mut result = context.alloc_pinned::<f32>(n).unwrap();
    source.as_mut_slice().iter_mut().enumerate().for_each(|(i, v)| *v = i as f32);
    let mut a = device.allocate::<f32>(&up, n, "a test").unwrap();
    let mut b = device.allocate::<f32>(&up, n, "a test").unwrap();
    up.memcpy_htod(source.as_slice(), &mut a).unwrap();
    if waits {
        compute.join(&up).unwrap();
    }
    scale(&device, &compute, &a, &mut b, (2.0, 1.0)).unwrap();
    scale(&device, &compute, &b, &mut a, (3.0, 0.0)).unwrap();
    if waits {
        down.join(&compute).unwrap();
    }
    down.memcpy_dtoh(&a, result.as_mut_slice()).unwrap();
    down.synchronize().unwrap();
    let got = result.as_slice().to_vec();
    context.synchronize().unwrap();
    got
}

fn streams_run_in_order() {
    for (i, v) in chain(true).into_iter().enumerate() {
        assert_eq!(v, 3.0 * (2.0 * i as f32 + 1.0));
    }
}

fn a_missing_wait_shows() {
    assert!(chain(false).iter().enumerate().any(|(i, v)| *v != 3.0 * (2.0 * i as f32 + 1.0)));
}

/// Pinned memory is read when its copy runs, not when it is asked for.
fn host_memory_reused_too_early_shows() {
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    let mut source = device.context.alloc_pinned::<f32>(4).unwrap();
    let first = source.as_mut_ptr();
    // SAFETY: four values lie there.
    unsafe { std::slice::from_raw_parts_mut(first, 4) }.fill(1.0);
    let mut there = device.allocate::<f32>(&stream, 4, "a test").unwrap();
    stream.memcpy_htod(source.as_slice(), &mut there).unwrap();
    // SAFETY: as above; the copy may be under way, which is the point.
    unsafe { std::slice::from_raw_parts_mut(first, 4) }.fill(2.0);
    assert_eq!(stream.clone_dtoh(&there).unwrap(), [2.0; 4]);
}

fn reverse(shared: u32) -> bool {
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    let from: Vec<f32> = (0..512).map(|i| i as f32).collect();
    let there = stream.clone_htod(&from).unwrap();
    let back = device.allocate::<f32>(&stream, 512, "a test").unwrap();
    let kernel = device.kernel(PROBE, "probe_reverse").unwrap();
    let shape = LaunchConfig { grid_dim: (2, 1, 1), block_dim: (256, 1, 1), shared_mem_bytes: shared };
    // SAFETY: two blocks of 256 values each; `shared` is what is tested.
    unsafe { stream.launch_builder(&kernel).arg(&there).arg(&back).launch(shape) }.unwrap();
    let back = stream.clone_dtoh(&back).unwrap();
    back.iter().enumerate().all(|(i, v)| *v as usize == i / 256 * 256 + 255 - i % 256)
}

fn a_block_shares_memory() {
    assert!(reverse(1024));
}

fn shared_memory_ends_where_it_was_asked_for() {
    reverse(1020);
}

fn warps_shuffle() {
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    let there = stream.clone_htod(&(0..128).map(|i| i as f32).collect::<Vec<_>>()).unwrap();
    let sums = device.allocate::<f32>(&stream, 128, "a test").unwrap();
    let kernel = device.kernel(PROBE, "probe_warp_sum").unwrap();
    let shape = LaunchConfig { grid_dim: (2, 1, 1), block_dim: (64, 1, 1), shared_mem_bytes: 0 };
    // SAFETY: the kernel reads and writes one value a thread.
    unsafe { stream.launch_builder(&kernel).arg(&there).arg(&sums).launch(shape) }.unwrap();
    for (i, sum) in stream.clone_dtoh(&sums).unwrap().into_iter().enumerate() {
        assert_eq!(sum, (0..32).map(|k| (i / 32 * 32 + k) as f32).sum::<f32>());
    }
}

fn parted_barriers_are_found() {
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    let out = device.allocate::<f32>(&stream, 64, "a test").unwrap();
    let kernel = device.kernel(PROBE, "probe_apart").unwrap();
    let shape = LaunchConfig { grid_dim: (1, 1, 1), block_dim: (64, 1, 1), shared_mem_bytes: 0 };
    // SAFETY: 64 values for 64 threads.
    let launched = unsafe { stream.launch_builder(&kernel).arg(&out).launch(shape) };
    assert!(launched.is_err() || stream.synchronize().is_err());
}

/// The driver refuses 17 of 16 values; the program's own copies never ask for that.
fn copies_beyond_an_allocation_are_refused() {
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    let mut to = device.allocate::<f32>(&stream, 16, "a test").unwrap();
    let beyond = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        stream.memcpy_dtoh(&to, &mut [0f32; 17]).is_ok() || stream.memcpy_htod(&[0f32; 17], &mut to).is_ok()
    }));
    assert!(beyond.is_err(), "17 values of 16");
}

fn a_kernel_beyond_its_memory_is_caught() {
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    let from = stream.clone_htod(&vec![1f32; 64]).unwrap();
    let mut to = device.allocate::<f32>(&stream, 63, "a test").unwrap();
    let _ = scale(&device, &stream, &from, &mut to, (1.0, 0.0));
    let _ = stream.synchronize();
}

fn no_driver_is_said() {
    assert_eq!(devices(), Err(CudaError::NoDriver));
    let error = Device::open(0).unwrap_err().to_string();
    assert!(error.contains("no NVIDIA driver") && error.contains("12.2"), "{error}");
}

fn no_device_is_said() {
    assert_eq!(devices(), Err(CudaError::NoDevice));
    assert!(Device::open(0).unwrap_err().to_string().contains("no GPU"));
}

fn a_driver_that_fails_is_said() {
    let error = devices().unwrap_err();
    assert!(
        matches!(&error, CudaError::Start { code } if code.contains("SYSTEM_DRIVER_MISMATCH, 803")),
        "{error}"
    );
}

fn an_old_driver_is_refused() {
    assert_eq!(devices(), Err(CudaError::DriverTooOld { found: (12, 1) }));
    let error = Device::open(0).unwrap_err().to_string();
    assert!(error.contains("12.1") && error.contains("12.2"), "{error}");
}

fn an_old_device_is_refused() {
    let error = Device::open(0).unwrap_err();
    assert!(matches!(error, CudaError::DeviceTooOld { found: (7, 5), .. }), "{error}");
}

fn devices_are_listed() {
    let all = devices().unwrap();
    assert_eq!(all.len(), 2);
    assert_eq!(all.iter().map(|d| d.compute_capability).collect::<Vec<_>>(), [(9, 0), (8, 6)]);
    assert_eq!(all.iter().map(|d| d.memory_bytes).collect::<Vec<_>>(), [2_000_000, 1_000_000]);
    assert!(all[0].shared_bytes > all[1].shared_bytes && all[1].driver_version == (12, 4));
    assert_eq!(Device::open(2).unwrap_err(), CudaError::NoSuchDevice { index: 2, count: 2 });
    assert_eq!(Device::open(1).unwrap().memory().unwrap(), (1_000_000, 1_000_000));
}

fn too_little_memory_is_said() {
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    let kept = device.allocate::<f32>(&stream, 200_000, "the chart").unwrap();
    let error = device.allocate::<f32>(&stream, 100_000, "spectra").unwrap_err();
    let CudaError::OutOfMemory { device: 0, asked_bytes, free_bytes, total_bytes, .. } = error else {
        panic!("{error}");
    };
    assert_eq!((asked_bytes, free_bytes, total_bytes), (400_000, 200_000, 1_000_000));
    let text = error.to_string();
    assert!(text.contains("spectra") && text.contains("400000") && text.contains("200000"), "{text}");
    // What is freed can be had again.
    drop(kept);
    device.allocate::<f32>(&stream, 200_000, "spectra").unwrap();
}

fn broken(device: &Device, stream: &Arc<CudaStream>) -> CudaError {
    let from = stream.clone_htod(&[1f32; 64]).unwrap();
    let mut to = device.allocate::<f32>(stream, 64, "a test").unwrap();
    for _ in 0..5 {
        let done = scale(device, stream, &from, &mut to, (1.0, 0.0))
            .and_then(|()| stream.synchronize().map_err(device.failed("waiting")));
        if let Err(error) = done {
            return error;
        }
    }
    panic!("all launches succeeded");
}

fn a_failing_kernel_is_no_lost_device() {
    let device = Device::open(0).unwrap();
    let error = broken(&device, &device.context.new_stream().unwrap());
    assert!(matches!(&error, CudaError::Kernel { device: 0, .. }) && !error.lost(), "{error}");
    assert!(error.to_string().contains("ILLEGAL_ADDRESS"), "{error}");
}

fn a_lost_device_leaves_the_others() {
    let (first, second) = (Device::open(0).unwrap(), Device::open(1).unwrap());
    let stream = second.context.new_stream().unwrap();
    let error = broken(&second, &stream);
    assert!(matches!(&error, CudaError::Lost { device: 1, .. }) && error.lost(), "{error}");
    assert!(second.memory().is_err() && stream.synchronize().is_err(), "what is lost stays lost");
    let stream = first.context.new_stream().unwrap();
    let from = stream.clone_htod(&[1f32; 64]).unwrap();
    let mut to = first.allocate::<f32>(&stream, 64, "a test").unwrap();
    for _ in 0..5 {
        scale(&first, &stream, &from, &mut to, (2.0, 0.0)).unwrap();
    }
    assert_eq!(stream.clone_dtoh(&to).unwrap(), [2f32; 64]);
}

/// Codes from drivers newer than this program are integers like any other.
fn codes_are_classified(code: i32) {
    let device = Device::open(0).unwrap();
    let error = broken(&device, &device.context.new_stream().unwrap());
    assert!(
        error.to_string().contains(&format!(", {code})"))
            || error.to_string().ends_with(&format!(", {code}")),
        "{error}"
    );
    match code {
        4242 => assert!(matches!(error, CudaError::Driver { .. }) && !error.retryable(), "{error}"),
        _ => assert!(error.lost() && error.retryable(), "{error}"),
    }
}

fn exclusive_use_is_not_a_lost_device() {
    let error = Device::open(0).unwrap_err();
    assert!(matches!(error, CudaError::InUse { .. }) && error.retryable() && !error.lost(), "{error}");
    assert!(error.to_string().contains("in use by another process"), "{error}");
}

fn page_locked_memory_is_not_the_devices() {
    let device = Device::open(0).unwrap();
    let error = device.allocate_pinned(100).unwrap_err();
    assert_eq!(error, CudaError::OutOfHostMemory { device: 0, asked_bytes: 400 });
    assert!(!error.out_of_memory() && error.retryable());
    assert_eq!(device.allocate_pinned(100).unwrap().as_slice(), [0f32; 100]);
}

fn main() -> ExitCode {
    let plain = Case::emulated;
    let must_fail = |case: Case| Case { must_fail: true, ..case };
    let built = |case: Case, build: Build| match case.on {
        On::Emulated(_, settings) => Case { on: On::Emulated(build, settings), ..case },
        _ => case,
    };
    const NO_BARRIER: Build = Build { sanitized: false, defines: "-DWITHOUT=1" };
    let mut cases = vec![
        Case {
            name: "no_driver_is_said".into(),
            run: no_driver_is_said,
            on: On::Nothing,
            must_fail: false,
            long: false,
        },
        Case::device("streams_run_in_order", streams_run_in_order),
        Case::device("a_block_shares_memory", || assert!(reverse(1024))),
        Case::device("warps_shuffle", warps_shuffle),
        plain("no_device_is_said", &[("DEVICES", "0")], no_device_is_said),
        plain("a_driver_that_fails_is_said", &[("INIT", "803")], a_driver_that_fails_is_said),
        plain("an_old_driver_is_refused", &[("DRIVER", "12010")], an_old_driver_is_refused),
        plain("an_old_device_is_refused", &[("CAPABILITY", "7.5")], an_old_device_is_refused),
        plain(
            "devices_are_listed",
            &[("DEVICES", "2"), ("CAPABILITY", "9.0,8.6"), ("MEMORY", "2e6,1e6"), ("DRIVER", "12040")],
            devices_are_listed,
        ),
        plain("too_little_memory_is_said", &[("MEMORY", "1e6")], too_little_memory_is_said),
        plain(
            "too_little_memory_is_said::deferred",
            &[("MEMORY", "1e6"), ("STREAMS", "deferred")],
            too_little_memory_is_said,
        ),
        plain(
            "a_failing_kernel_is_no_lost_device",
            &[("FAULTS", "kernel:0:3")],
            a_failing_kernel_is_no_lost_device,
        ),
        plain(
            "a_lost_device_leaves_the_others",
            &[("DEVICES", "2"), ("FAULTS", "lost:1:2"), ("STREAMS", "deferred")],
            a_lost_device_leaves_the_others,
        ),
        plain("codes_are_classified::226", &[("FAULTS", "error-226:0:2")], || codes_are_classified(226)),
        plain("codes_are_classified::721", &[("FAULTS", "error-721:0:2"), ("STREAMS", "deferred")], || {
            codes_are_classified(721)
        }),
        plain("codes_are_classified::999", &[("FAULTS", "error-999:0:2")], || codes_are_classified(999)),
        plain("codes_are_classified::4242", &[("FAULTS", "error-4242:0:2"), ("STREAMS", "deferred")], || {
            codes_are_classified(4242)
        }),
        plain("exclusive_use_is_not_a_lost_device", &[("OPEN", "46")], exclusive_use_is_not_a_lost_device),
        plain(
            "page_locked_memory_is_not_the_devices",
            &[("FAULTS", "host-memory:0:1")],
            page_locked_memory_is_not_the_devices,
        ),
        plain("streams_run_in_order::eager", &[], streams_run_in_order),
        plain("streams_run_in_order::deferred", &[("STREAMS", "deferred")], streams_run_in_order),
        plain("streams_run_in_order::hasty", &[("STREAMS", "hasty")], streams_run_in_order),
        plain("a_missing_wait_shows::deferred", &[("STREAMS", "deferred")], a_missing_wait_shows),
        plain("a_missing_wait_shows::hasty", &[("STREAMS", "hasty")], a_missing_wait_shows),
        plain(
            "host_memory_reused_too_early_shows",
            &[("STREAMS", "deferred")],
            host_memory_reused_too_early_shows,
        ),
        plain("a_block_shares_memory", &[], a_block_shares_memory),
        plain("a_block_shares_memory::reverse", &[("ORDER", "reverse")], a_block_shares_memory),
        plain("a_block_shares_memory::random", &[("ORDER", "random")], a_block_shares_memory),
        must_fail(built(plain("a_missing_barrier_shows", &[], a_block_shares_memory), NO_BARRIER)),
        plain("warps_shuffle", &[("ORDER", "random")], warps_shuffle),
        plain("parted_barriers_are_found", &[], parted_barriers_are_found),
        plain("copies_beyond_an_allocation_are_refused", &[], copies_beyond_an_allocation_are_refused),
    ];
    cases.push(built(plain("a_block_shares_memory::watched", &[], a_block_shares_memory), WATCHED));
    let beyond: [(&str, fn()); 2] = [
        ("a_kernel_beyond_its_memory_is_caught", a_kernel_beyond_its_memory_is_caught),
        ("shared_memory_ends_where_it_was_asked_for", shared_memory_ends_where_it_was_asked_for),
    ];
    for (name, run) in beyond {
        cases.push(must_fail(built(plain(name, &[], run), WATCHED)));
    }
    debug_assert!(PLAIN.defines.is_empty());
    emulated_cuda::run(cases)
}
