//! Opening of GPUs and its errors, on the emulated driver; and tests of that driver: what it runs and which mistakes it detects.

#![allow(unsafe_code, reason = "kernels are launched directly")]

mod emulated_cuda;

use emulated_cuda::{Build, Case, PLAIN, SANITIZED_BUILD, Target};
use lenscube_pipeline::cuda::handle::CudaStream;
use lenscube_pipeline::cuda::launch::LaunchConfig;
use lenscube_pipeline::cuda::slice::{CudaSlice, DeviceMemory};
use lenscube_pipeline::cuda::{CudaError, Device, devices};
use std::process::ExitCode;
use std::sync::Arc;

const PROBE: &str = include_str!("../ptx/probe.ptx");

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

/// Upload, two kernels on another stream, download; ordered by events only if `waits`.
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

fn events_order_streams() {
    for (i, v) in chain(true).into_iter().enumerate() {
        assert_eq!(v, 3.0 * (2.0 * i as f32 + 1.0));
    }
}

fn missing_wait_changes_the_result() {
    assert!(chain(false).iter().enumerate().any(|(i, v)| *v != 3.0 * (2.0 * i as f32 + 1.0)));
}

/// Page-locked memory is read when its copy runs, not when the copy is enqueued.
fn host_memory_reused_before_its_copy_changes_the_result() {
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    let mut source = device.context.alloc_pinned::<f32>(4).unwrap();
    let first = source.as_mut_ptr();
    // SAFETY: four values lie there.
    unsafe { std::slice::from_raw_parts_mut(first, 4) }.fill(1.0);
    let mut there = device.allocate::<f32>(&stream, 4, "a test").unwrap();
    stream.memcpy_htod(source.as_slice(), &mut there).unwrap();
    // SAFETY: as above; the copy may be running, which is what the test is about.
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

fn block_reverses_values_in_shared_memory() {
    assert!(reverse(1024));
}

fn access_beyond_shared_memory_is_detected() {
    reverse(1020);
}

fn shuffles_sum_a_warp() {
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

fn barrier_reached_by_half_of_the_threads_is_an_error() {
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    let out = device.allocate::<f32>(&stream, 64, "a test").unwrap();
    let kernel = device.kernel(PROBE, "probe_apart").unwrap();
    let shape = LaunchConfig { grid_dim: (1, 1, 1), block_dim: (64, 1, 1), shared_mem_bytes: 0 };
    // SAFETY: 64 values for 64 threads.
    let launched = unsafe { stream.launch_builder(&kernel).arg(&out).launch(shape) };
    assert!(launched.is_err() || stream.synchronize().is_err());
}

/// A copy of 17 of 16 values; the program never requests one.
fn copy_beyond_an_allocation_panics() {
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    let mut to = device.allocate::<f32>(&stream, 16, "a test").unwrap();
    let beyond = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        stream.memcpy_dtoh(&to, &mut [0f32; 17]).is_ok() || stream.memcpy_htod(&[0f32; 17], &mut to).is_ok()
    }));
    assert!(beyond.is_err(), "17 values of 16");
}

fn kernel_access_beyond_its_memory_is_detected() {
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    let from = stream.clone_htod(&vec![1f32; 64]).unwrap();
    let mut to = device.allocate::<f32>(&stream, 63, "a test").unwrap();
    let _ = scale(&device, &stream, &from, &mut to, (1.0, 0.0));
    let _ = stream.synchronize();
}

fn missing_driver_is_reported_with_the_required_version() {
    assert_eq!(devices(), Err(CudaError::NoDriver));
    let error = Device::open(0).unwrap_err().to_string();
    assert!(error.contains("no NVIDIA driver") && error.contains("12.2"), "{error}");
}

fn driver_without_gpu_is_reported() {
    assert_eq!(devices(), Err(CudaError::NoDevice));
    assert!(Device::open(0).unwrap_err().to_string().contains("no GPU"));
}

fn driver_start_error_is_reported_with_its_code() {
    let error = devices().unwrap_err();
    assert!(
        matches!(&error, CudaError::Start { code } if code.contains("SYSTEM_DRIVER_MISMATCH, 803")),
        "{error}"
    );
}

fn old_driver_is_an_error_with_both_versions() {
    assert_eq!(devices(), Err(CudaError::DriverTooOld { found: (12, 1) }));
    let error = Device::open(0).unwrap_err().to_string();
    assert!(error.contains("12.1") && error.contains("12.2"), "{error}");
}

fn old_device_is_an_error_with_its_capability() {
    let error = Device::open(0).unwrap_err();
    assert!(matches!(error, CudaError::DeviceTooOld { found: (7, 5), .. }), "{error}");
}

fn devices_are_listed_with_their_properties() {
    let all = devices().unwrap();
    assert_eq!(all.len(), 2);
    assert_eq!(all.iter().map(|d| d.compute_capability).collect::<Vec<_>>(), [(9, 0), (8, 6)]);
    assert_eq!(all.iter().map(|d| d.memory_bytes).collect::<Vec<_>>(), [2_000_000, 1_000_000]);
    assert!(all[0].shared_bytes > all[1].shared_bytes && all[1].driver_version == (12, 4));
    assert_eq!(Device::open(2).unwrap_err(), CudaError::NoSuchDevice { index: 2, count: 2 });
    assert_eq!(Device::open(1).unwrap().memory().unwrap(), (1_000_000, 1_000_000));
}

fn out_of_memory_reports_requested_and_free_bytes() {
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    let kept = device.allocate::<f32>(&stream, 200_000, "the chart").unwrap();
    let error = device.allocate::<f32>(&stream, 100_000, "spectra").unwrap_err();
    let CudaError::OutOfMemory { device: 0, requested_bytes, free_bytes, total_bytes, .. } = error else {
        panic!("{error}");
    };
    assert_eq!((requested_bytes, free_bytes, total_bytes), (400_000, 200_000, 1_000_000));
    let text = error.to_string();
    assert!(text.contains("spectra") && text.contains("400000") && text.contains("200000"), "{text}");
    // Freed memory can be allocated again.
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

fn failed_kernel_is_not_a_lost_device() {
    let device = Device::open(0).unwrap();
    let error = broken(&device, &device.context.new_stream().unwrap());
    assert!(matches!(&error, CudaError::Kernel { device: 0, .. }) && !error.is_lost(), "{error}");
    assert!(error.to_string().contains("ILLEGAL_ADDRESS"), "{error}");
}

fn lost_device_does_not_affect_other_devices() {
    let (first, second) = (Device::open(0).unwrap(), Device::open(1).unwrap());
    let stream = second.context.new_stream().unwrap();
    let error = broken(&second, &stream);
    assert!(matches!(&error, CudaError::Lost { device: 1, .. }) && error.is_lost(), "{error}");
    assert!(second.memory().is_err() && stream.synchronize().is_err(), "a lost device stays lost");
    let stream = first.context.new_stream().unwrap();
    let from = stream.clone_htod(&[1f32; 64]).unwrap();
    let mut to = first.allocate::<f32>(&stream, 64, "a test").unwrap();
    for _ in 0..5 {
        scale(&first, &stream, &from, &mut to, (2.0, 0.0)).unwrap();
    }
    assert_eq!(stream.clone_dtoh(&to).unwrap(), [2f32; 64]);
}

/// Codes of newer drivers are accepted too.
fn error_code_is_classified(code: i32) {
    let device = Device::open(0).unwrap();
    let error = broken(&device, &device.context.new_stream().unwrap());
    assert!(
        error.to_string().contains(&format!(", {code})"))
            || error.to_string().ends_with(&format!(", {code}")),
        "{error}"
    );
    match code {
        4242 => assert!(matches!(error, CudaError::Driver { .. }) && !error.retryable(), "{error}"),
        _ => assert!(error.is_lost() && error.retryable(), "{error}"),
    }
}

fn device_in_exclusive_use_is_not_lost() {
    let error = Device::open(0).unwrap_err();
    assert!(matches!(error, CudaError::InUse { .. }) && error.retryable() && !error.is_lost(), "{error}");
    assert!(error.to_string().contains("in use by another process"), "{error}");
}

fn out_of_host_memory_is_not_out_of_device_memory() {
    let device = Device::open(0).unwrap();
    let error = device.allocate_pinned(100).unwrap_err();
    assert_eq!(error, CudaError::OutOfHostMemory { device: 0, requested_bytes: 400 });
    assert!(error.is_out_of_memory() && error.retryable());
    assert_eq!(device.allocate_pinned(100).unwrap().as_slice(), [0f32; 100]);
}

fn main() -> ExitCode {
    let plain = Case::emulated;
    let must_fail = |case: Case| Case { must_fail: true, ..case };
    let built = |case: Case, build: Build| match case.target {
        Target::Emulated(_, settings) => Case { target: Target::Emulated(build, settings), ..case },
        _ => case,
    };
    const NO_BARRIER: Build = Build { sanitized: false, defines: "-DWITHOUT=1" };
    let mut cases = vec![
        Case {
            name: "missing_driver_is_reported_with_the_required_version".into(),
            run: missing_driver_is_reported_with_the_required_version,
            target: Target::NoDriver,
            must_fail: false,
            long: false,
        },
        Case::device("events_order_streams", events_order_streams),
        Case::device("block_reverses_values_in_shared_memory", || assert!(reverse(1024))),
        Case::device("shuffles_sum_a_warp", shuffles_sum_a_warp),
        plain("driver_without_gpu_is_reported", &[("DEVICES", "0")], driver_without_gpu_is_reported),
        plain(
            "driver_start_error_is_reported_with_its_code",
            &[("INIT", "803")],
            driver_start_error_is_reported_with_its_code,
        ),
        plain(
            "old_driver_is_an_error_with_both_versions",
            &[("DRIVER", "12010")],
            old_driver_is_an_error_with_both_versions,
        ),
        plain(
            "old_device_is_an_error_with_its_capability",
            &[("CAPABILITY", "7.5")],
            old_device_is_an_error_with_its_capability,
        ),
        plain(
            "devices_are_listed_with_their_properties",
            &[("DEVICES", "2"), ("CAPABILITY", "9.0,8.6"), ("MEMORY", "2e6,1e6"), ("DRIVER", "12040")],
            devices_are_listed_with_their_properties,
        ),
        plain(
            "out_of_memory_reports_requested_and_free_bytes",
            &[("MEMORY", "1e6")],
            out_of_memory_reports_requested_and_free_bytes,
        ),
        plain(
            "out_of_memory_reports_requested_and_free_bytes::deferred",
            &[("MEMORY", "1e6"), ("STREAMS", "deferred")],
            out_of_memory_reports_requested_and_free_bytes,
        ),
        plain(
            "failed_kernel_is_not_a_lost_device",
            &[("FAULTS", "kernel:0:3")],
            failed_kernel_is_not_a_lost_device,
        ),
        plain(
            "lost_device_does_not_affect_other_devices",
            &[("DEVICES", "2"), ("FAULTS", "lost:1:2"), ("STREAMS", "deferred")],
            lost_device_does_not_affect_other_devices,
        ),
        plain("error_code_is_classified::226", &[("FAULTS", "error-226:0:2")], || {
            error_code_is_classified(226)
        }),
        plain(
            "error_code_is_classified::721",
            &[("FAULTS", "error-721:0:2"), ("STREAMS", "deferred")],
            || error_code_is_classified(721),
        ),
        plain("error_code_is_classified::999", &[("FAULTS", "error-999:0:2")], || {
            error_code_is_classified(999)
        }),
        plain(
            "error_code_is_classified::4242",
            &[("FAULTS", "error-4242:0:2"), ("STREAMS", "deferred")],
            || error_code_is_classified(4242),
        ),
        plain("device_in_exclusive_use_is_not_lost", &[("OPEN", "46")], device_in_exclusive_use_is_not_lost),
        plain(
            "out_of_host_memory_is_not_out_of_device_memory",
            &[("FAULTS", "host-memory:0:1")],
            out_of_host_memory_is_not_out_of_device_memory,
        ),
        plain("events_order_streams::eager", &[], events_order_streams),
        plain("events_order_streams::deferred", &[("STREAMS", "deferred")], events_order_streams),
        plain("events_order_streams::hasty", &[("STREAMS", "hasty")], events_order_streams),
        plain(
            "missing_wait_changes_the_result::deferred",
            &[("STREAMS", "deferred")],
            missing_wait_changes_the_result,
        ),
        plain(
            "missing_wait_changes_the_result::hasty",
            &[("STREAMS", "hasty")],
            missing_wait_changes_the_result,
        ),
        plain(
            "host_memory_reused_before_its_copy_changes_the_result",
            &[("STREAMS", "deferred")],
            host_memory_reused_before_its_copy_changes_the_result,
        ),
        plain("block_reverses_values_in_shared_memory", &[], block_reverses_values_in_shared_memory),
        plain(
            "block_reverses_values_in_shared_memory::reverse",
            &[("ORDER", "reverse")],
            block_reverses_values_in_shared_memory,
        ),
        plain(
            "block_reverses_values_in_shared_memory::random",
            &[("ORDER", "random")],
            block_reverses_values_in_shared_memory,
        ),
        must_fail(built(
            plain("missing_barrier_is_detected", &[], block_reverses_values_in_shared_memory),
            NO_BARRIER,
        )),
        plain("shuffles_sum_a_warp", &[("ORDER", "random")], shuffles_sum_a_warp),
        plain(
            "barrier_reached_by_half_of_the_threads_is_an_error",
            &[],
            barrier_reached_by_half_of_the_threads_is_an_error,
        ),
        plain("copy_beyond_an_allocation_panics", &[], copy_beyond_an_allocation_panics),
    ];
    cases.push(built(
        plain(
            "block_reverses_values_in_shared_memory::sanitized",
            &[],
            block_reverses_values_in_shared_memory,
        ),
        SANITIZED_BUILD,
    ));
    let beyond: [(&str, fn()); 2] = [
        ("kernel_access_beyond_its_memory_is_detected", kernel_access_beyond_its_memory_is_detected),
        ("access_beyond_shared_memory_is_detected", access_beyond_shared_memory_is_detected),
    ];
    for (name, run) in beyond {
        cases.push(must_fail(built(plain(name, &[], run), SANITIZED_BUILD)));
    }
    debug_assert!(PLAIN.defines.is_empty());
    emulated_cuda::run(cases)
}
