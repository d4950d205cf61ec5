//! Opening of GPUs and its errors, on the emulated driver; and tests of that driver: what it runs and which mistakes it detects.

#![allow(unsafe_code, reason = "kernels are launched directly")]

#[path = "../emulated_cuda/mod.rs"]
mod emulated_cuda;
mod errors;

use emulated_cuda::{Build, Case, PLAIN, SANITIZED_BUILD, Target};
use lenscube_pipeline::cuda::device::FORCE_ASSEMBLY;
use lenscube_pipeline::cuda::handle::CudaStream;
use lenscube_pipeline::cuda::launch::LaunchConfig;
use lenscube_pipeline::cuda::ptx::{self, Kernels};
use lenscube_pipeline::cuda::slice::{CudaSlice, DeviceMemory};
use lenscube_pipeline::cuda::{CudaError, Device, devices};
use std::process::ExitCode;
use std::sync::Arc;

static PROBE: Kernels = Kernels::of_ptx(include_str!("../../ptx/probe.ptx"));

fn scale(
    device: &Device,
    stream: &Arc<CudaStream>,
    from: &CudaSlice<f32>,
    to: &mut CudaSlice<f32>,
    (a, b): (f32, f32),
) -> Result<(), CudaError> {
    let kernel = device.kernel(&PROBE, "probe_scale")?;
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
    let kernel = device.kernel(&PROBE, "probe_reverse").unwrap();
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
    let kernel = device.kernel(&PROBE, "probe_warp_sum").unwrap();
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
    let kernel = device.kernel(&PROBE, "probe_apart").unwrap();
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
/// Numbers of cubins loaded and of PTX files assembled for one kernel.
fn loaded_and_assembled() -> (usize, usize) {
    let device = Device::open(0).unwrap();
    device.kernel(&ptx::OVERLAP_ADD, "add_tiles").unwrap();
    assert!(device.thread_resources().keys().eq(["add_tiles"]));
    let loading = device.kernel_loading();
    (loading.cubins, loading.assembled)
}

fn forced_assembly_ignores_cubins() {
    // SAFETY: the process of this case has no other thread yet.
    unsafe { std::env::set_var(FORCE_ASSEMBLY, "1") };
    assert_eq!(loaded_and_assembled(), (0, 1));
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
            run: errors::missing_driver_is_reported_with_the_required_version,
            target: Target::NoDriver,
            must_fail: false,
            long: false,
        },
        Case::device("events_order_streams", events_order_streams),
        Case::device("block_reverses_values_in_shared_memory", || assert!(reverse(1024))),
        Case::device("shuffles_sum_a_warp", shuffles_sum_a_warp),
        plain("driver_without_gpu_is_reported", &[("DEVICES", "0")], errors::driver_without_gpu_is_reported),
        plain(
            "driver_start_error_is_reported_with_its_code",
            &[("INIT", "803")],
            errors::driver_start_error_is_reported_with_its_code,
        ),
        plain(
            "old_driver_is_an_error_with_both_versions",
            &[("DRIVER", "12010")],
            errors::old_driver_is_an_error_with_both_versions,
        ),
        plain(
            "old_device_is_an_error_with_its_capability",
            &[("CAPABILITY", "7.5")],
            errors::old_device_is_an_error_with_its_capability,
        ),
        plain(
            "devices_are_listed_with_their_properties",
            &[("DEVICES", "2"), ("CAPABILITY", "9.0,8.6"), ("MEMORY", "2e6,1e6"), ("DRIVER", "12040")],
            errors::devices_are_listed_with_their_properties,
        ),
        plain(
            "out_of_memory_reports_requested_and_free_bytes",
            &[("MEMORY", "1e6")],
            errors::out_of_memory_reports_requested_and_free_bytes,
        ),
        plain(
            "out_of_memory_reports_requested_and_free_bytes::deferred",
            &[("MEMORY", "1e6"), ("STREAMS", "deferred")],
            errors::out_of_memory_reports_requested_and_free_bytes,
        ),
        plain(
            "failed_kernel_is_not_a_lost_device",
            &[("FAULTS", "kernel:0:3")],
            errors::failed_kernel_is_not_a_lost_device,
        ),
        plain(
            "lost_device_does_not_affect_other_devices",
            &[("DEVICES", "2"), ("FAULTS", "lost:1:2"), ("STREAMS", "deferred")],
            errors::lost_device_does_not_affect_other_devices,
        ),
        plain("error_code_is_classified::226", &[("FAULTS", "error-226:0:2")], || {
            errors::error_code_is_classified(226)
        }),
        plain(
            "error_code_is_classified::721",
            &[("FAULTS", "error-721:0:2"), ("STREAMS", "deferred")],
            || errors::error_code_is_classified(721),
        ),
        plain("error_code_is_classified::999", &[("FAULTS", "error-999:0:2")], || {
            errors::error_code_is_classified(999)
        }),
        plain(
            "error_code_is_classified::4242",
            &[("FAULTS", "error-4242:0:2"), ("STREAMS", "deferred")],
            || errors::error_code_is_classified(4242),
        ),
        plain(
            "device_in_exclusive_use_is_not_lost",
            &[("OPEN", "46")],
            errors::device_in_exclusive_use_is_not_lost,
        ),
        plain(
            "out_of_host_memory_is_not_out_of_device_memory",
            &[("FAULTS", "host-memory:0:1")],
            errors::out_of_host_memory_is_not_out_of_device_memory,
        ),
        plain("cubin_of_the_architecture_is_loaded::8.9", &[("CAPABILITY", "8.9"), ("CUBINS", "1")], || {
            assert_eq!(loaded_and_assembled(), (1, 0));
        }),
        plain(
            "cubin_of_the_architecture_is_loaded::12.1",
            &[("CAPABILITY", "12.1"), ("CUBINS", "1")],
            || {
                assert_eq!(loaded_and_assembled(), (1, 0));
            },
        ),
        plain("gpu_without_a_cubin_assembles", &[("CAPABILITY", "11.0"), ("CUBINS", "1")], || {
            assert_eq!(loaded_and_assembled(), (0, 1));
        }),
        plain("refused_cubin_is_replaced_by_assembly", &[("CAPABILITY", "9.0")], || {
            assert_eq!(loaded_and_assembled(), (0, 1));
        }),
        plain(
            "forced_assembly_ignores_cubins",
            &[("CAPABILITY", "9.0"), ("CUBINS", "1")],
            forced_assembly_ignores_cubins,
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
