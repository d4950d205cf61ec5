//! Opening of GPUs and its errors; errors of memory and kernels, and of lost devices.

use super::*;

pub fn missing_driver_is_reported_with_the_required_version() {
    assert_eq!(devices(), Err(CudaError::NoDriver));
    let error = Device::open(0).unwrap_err().to_string();
    assert!(error.contains("no NVIDIA driver") && error.contains("12.2"), "{error}");
}

pub fn driver_without_gpu_is_reported() {
    assert_eq!(devices(), Err(CudaError::NoDevice));
    assert!(Device::open(0).unwrap_err().to_string().contains("no GPU"));
}

pub fn driver_start_error_is_reported_with_its_code() {
    let error = devices().unwrap_err();
    assert!(
        matches!(&error, CudaError::Start { code } if code.contains("SYSTEM_DRIVER_MISMATCH, 803")),
        "{error}"
    );
}

pub fn old_driver_is_an_error_with_both_versions() {
    assert_eq!(devices(), Err(CudaError::DriverTooOld { found: (12, 1) }));
    let error = Device::open(0).unwrap_err().to_string();
    assert!(error.contains("12.1") && error.contains("12.2"), "{error}");
}

pub fn old_device_is_an_error_with_its_capability() {
    let error = Device::open(0).unwrap_err();
    assert!(matches!(error, CudaError::DeviceTooOld { found: (7, 5), .. }), "{error}");
}

pub fn devices_are_listed_with_their_properties() {
    let all = devices().unwrap();
    assert_eq!(all.len(), 2);
    assert_eq!(all.iter().map(|d| d.compute_capability).collect::<Vec<_>>(), [(9, 0), (8, 6)]);
    assert_eq!(all.iter().map(|d| d.memory_bytes).collect::<Vec<_>>(), [2_000_000, 1_000_000]);
    assert!(all[0].shared_bytes > all[1].shared_bytes && all[1].driver_version == (12, 4));
    assert_eq!(Device::open(2).unwrap_err(), CudaError::NoSuchDevice { index: 2, count: 2 });
    assert_eq!(Device::open(1).unwrap().memory().unwrap(), (1_000_000, 1_000_000));
}

pub fn out_of_memory_reports_requested_and_free_bytes() {
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

pub fn failed_kernel_is_not_a_lost_device() {
    let device = Device::open(0).unwrap();
    let error = broken(&device, &device.context.new_stream().unwrap());
    assert!(matches!(&error, CudaError::Kernel { device: 0, .. }) && !error.is_lost(), "{error}");
    assert!(error.to_string().contains("ILLEGAL_ADDRESS"), "{error}");
}

pub fn lost_device_does_not_affect_other_devices() {
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
pub fn error_code_is_classified(code: i32) {
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

pub fn device_in_exclusive_use_is_not_lost() {
    let error = Device::open(0).unwrap_err();
    assert!(matches!(error, CudaError::InUse { .. }) && error.retryable() && !error.is_lost(), "{error}");
    assert!(error.to_string().contains("in use by another process"), "{error}");
}

pub fn out_of_host_memory_is_not_out_of_device_memory() {
    let device = Device::open(0).unwrap();
    let error = device.allocate_pinned(100).unwrap_err();
    assert_eq!(error, CudaError::OutOfHostMemory { device: 0, requested_bytes: 400 });
    assert!(error.is_out_of_memory() && error.retryable());
    assert_eq!(device.allocate_pinned(100).unwrap().as_slice(), [0f32; 100]);
}
