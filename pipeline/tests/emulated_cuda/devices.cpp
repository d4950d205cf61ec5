// Devices, contexts, settings and errors of the emulated driver. Settings are environment variables:
//
//   EMULATED_CUDA_DEVICES=2              number of devices (1)
//   EMULATED_CUDA_UUID=2,1               UUID of each, as the value of its bytes (number of the device, from 1)
//   EMULATED_CUDA_MEMORY=1e9,4e8         bytes of each (4 GiB)
//   EMULATED_CUDA_CAPABILITY=9.0,8.6     compute capability of each (8.0)
//   EMULATED_CUDA_DRIVER=12020           version (12020); newer PTX is rejected
//   EMULATED_CUDA_CUBINS=1               cubins are loaded (their kernels are not executed: those built for the CPU are); else refused
//   EMULATED_CUDA_DELAY_US=0,500         delay of every kernel of each, us
//   EMULATED_CUDA_UNTIL_LOST=1           kernels of the other devices end once this one is lost, or after 60 s
//   EMULATED_CUDA_STREAMS, _ORDER        driver.h, cuda_cpu.h
//   EMULATED_CUDA_FAULTS=lost:1:3,...    KIND:DEVICE:N, fault of the N-th (from 1) launch or allocation of a device:
//                                        lost, kernel (breaks the context), refused (this launch only), memory, host-memory
//                                        (page-locked); error-CODE: result of this launch and of every later call
//   EMULATED_CUDA_INIT=100               result of cuInit
//   EMULATED_CUDA_OPEN=0,46              result of creating the context of each
//   EMULATED_CUDA_LOG=path               file to which a line with counts for each used device is appended at exit
#include "driver.h"
#include <cstdarg>
#include <cstdio>
#include <chrono>
#include <cstdlib>
#include <thread>

namespace emulated {

const char *setting(const char *name) { return std::getenv(("EMULATED_CUDA_" + std::string(name)).c_str()); }

double setting(const char *name, int i, double otherwise) {
    const char *at = setting(name);
    if (!at || !*at) return otherwise;
    for (const char *next; i > 0 && (next = std::strchr(at, ',')); --i) at = next + 1;
    return std::atof(at);
}

int driver_version() { return int(setting("DRIVER", 0, 12020)); }

bool fails(const char *kind, int device, unsigned long n) {
    const char *faults = setting("FAULTS");
    if (!faults) return false;
    char one[64];
    std::snprintf(one, sizeof one, ",%s:%d:%lu,", kind, device, n);
    return ("," + std::string(faults) + ",").find(one) != std::string::npos;
}

CUresult error_of_launch(int device, unsigned long n) {
    const char *faults = setting("FAULTS");
    char place[64];
    std::snprintf(place, sizeof place, ":%d:%lu,", device, n);
    const std::string all = faults ? std::string(faults) + "," : "";
    for (size_t at = 0; (at = all.find("error-", at)) != std::string::npos; ++at) {
        const size_t colon = all.find(':', at);
        if (colon != std::string::npos && all.compare(colon, std::strlen(place), place) == 0) return std::atoi(all.c_str() + at + 6);
    }
    return SUCCESS;
}

CUresult wrong(CUresult code, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    std::fputs("emulated driver: ", stderr);
    std::vfprintf(stderr, format, arguments);
    std::fputc('\n', stderr);
    va_end(arguments);
    return code;
}

size_t Device::shared_limit() const {
    if (major == 8 && minor == 0) return 166912;
    if (major == 9 || major == 10) return 232448;
    return 101376;
}

static bool initialised = false;

// All devices; never freed.
static std::vector<std::unique_ptr<Device>> &devices() {
    static auto *all = [] {
        auto *all = new std::vector<std::unique_ptr<Device>>;
        const int count = int(setting("DEVICES", 0, 1));
        for (int i = 0; i < count; ++i) {
            auto device = std::make_unique<Device>();
            device->index = i;
            device->memory = size_t(setting("MEMORY", i, 4.0 * (1u << 30)));
            const int capability = int(10 * setting("CAPABILITY", i, 8.0) + 0.5);
            device->major = capability / 10;
            device->minor = capability % 10;
            device->delay_us = int(setting("DELAY_US", i, 0));
            device->standard = std::make_shared<Stream>();
            device->standard->device = device.get();
            all->push_back(std::move(device));
        }
        return all;
    }();
    return *all;
}

static Device *find(CUdevice device) {
    return device >= 0 && size_t(device) < devices().size() ? devices()[device].get() : nullptr;
}

void wait_until_lost(const Device &device) {
    Device *other = find(int(setting("UNTIL_LOST", 0, -1)));
    if (!other || other == &device) return;
    for (int ms = 0; ms < 60000 && other->lost == SUCCESS; ++ms) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

static thread_local Device *current = nullptr;

Current::Current() : device(current), error(SUCCESS) {
    if (!initialised) error = NOT_INITIALIZED;
    else if (!device) error = wrong(INVALID_CONTEXT, "no context is current on this thread");
    if (error) return;
    lock = std::unique_lock<std::recursive_mutex>(device->lock);
    error = device->lost;
}

__attribute__((destructor)) static void write_log() {
    const char *path = setting("LOG");
    FILE *file = path && initialised ? std::fopen(path, "a") : nullptr;
    if (!file) return;
    for (auto &d : devices()) {
        size_t pending = d->standard->pending.size();
        for (auto &s : d->streams) pending += s.second->pending.size();
        if (d->launches + d->allocations)
            std::fprintf(file, "device %d launches %lu up %lu down %lu peak %zu left %zu streams %zu events %zu pending %zu\n",
                         d->index, d->launches, d->up, d->down, d->peak, d->live.size(), d->streams.size(), d->events.size(), pending);
    }
    std::fclose(file);
}

}  // namespace emulated

using namespace emulated;

extern "C" {

CUresult cuInit(unsigned) {
    const int code = int(setting("INIT", 0, 0));
    if (code) return code;
    if (devices().empty()) return NO_DEVICE;
    initialised = true;
    return SUCCESS;
}

CUresult cuDriverGetVersion(int *version) {
    *version = driver_version();
    return SUCCESS;
}

CUresult cuDeviceGetCount(int *count) {
    if (!initialised) return NOT_INITIALIZED;
    *count = int(devices().size());
    return SUCCESS;
}

CUresult cuDeviceGet(CUdevice *device, int ordinal) {
    if (!initialised) return NOT_INITIALIZED;
    if (!find(ordinal)) return INVALID_DEVICE;
    *device = ordinal;
    return SUCCESS;
}

CUresult cuDeviceGetName(char *name, int length, CUdevice device) {
    Device *d = find(device);
    if (!d) return INVALID_DEVICE;
    std::snprintf(name, length, "Emulated GPU %d.%d", d->major, d->minor);
    return SUCCESS;
}

CUresult cuDeviceGetUuid_v2(char *uuid, CUdevice device) {
    if (!find(device)) return INVALID_DEVICE;
    std::memset(uuid, int(setting("UUID", device, device + 1)), 16);
    return SUCCESS;
}

CUresult cuDeviceTotalMem_v2(size_t *bytes, CUdevice device) {
    if (!find(device)) return INVALID_DEVICE;
    *bytes = find(device)->memory;
    return SUCCESS;
}

// Numbers as in cuda.h.
CUresult cuDeviceGetAttribute(int *value, int attribute, CUdevice device) {
    Device *d = find(device);
    if (!d) return INVALID_DEVICE;
    switch (attribute) {
        case 1: *value = 1024; break;                          // threads of a block
        case 2: case 3: *value = 1024; break;                  // along x, y
        case 4: *value = 64; break;                            // along z
        case 5: *value = 0x7fffffff; break;                    // blocks along x
        case 6: case 7: *value = 65535; break;                 // along y, z
        case 8: *value = 49152; break;                         // shared memory of a block
        case 10: *value = warpSize; break;
        case 12: case 82: *value = 65536; break;               // registers of a block, of a multiprocessor
        case 13: *value = 1755000; break;                      // clock, kHz
        case 16: *value = 4; break;                            // multiprocessors
        case 36: *value = 3201000; break;                      // memory clock, kHz
        case 37: *value = 5120; break;                         // memory bus, bits
        case 38: *value = 41943040; break;                     // L2 cache
        case 39: *value = 2048; break;                         // threads of a multiprocessor
        case 40: *value = 2; break;                            // copy engines
        case 41: case 115: *value = 1; break;                  // unified addressing, memory pools
        case 75: *value = d->major; break;
        case 76: *value = d->minor; break;
        case 81: *value = int(d->shared_limit() + 1024); break;   // shared memory of a multiprocessor
        case 97: *value = int(d->shared_limit()); break;          // of a block, opt-in
        default: return wrong(INVALID_VALUE, "device attribute %d is not emulated", attribute);
    }
    return SUCCESS;
}

CUresult cuDevicePrimaryCtxRetain(CUcontext *context, CUdevice device) {
    Device *d = find(device);
    if (!d) return INVALID_DEVICE;
    if (const int code = int(setting("OPEN", device, 0))) return code;
    *context = reinterpret_cast<CUcontext>(d);
    return d->lost;
}

CUresult cuDevicePrimaryCtxRelease_v2(CUdevice device) { return find(device) ? SUCCESS : INVALID_DEVICE; }

CUresult cuCtxGetCurrent(CUcontext *context) {
    *context = reinterpret_cast<CUcontext>(current);
    return initialised ? SUCCESS : NOT_INITIALIZED;
}

CUresult cuCtxSetCurrent(CUcontext context) {
    current = reinterpret_cast<Device *>(context);
    return initialised ? SUCCESS : NOT_INITIALIZED;
}

CUresult cuCtxSetFlags(unsigned) { return Current().error; }

CUresult cuCtxSynchronize() {
    Current c;
    return c.error ? c.error : drain_all(*c.device);
}

CUresult cuGetErrorName(CUresult code, const char **name) {
    switch (code) {
        case SUCCESS: *name = "CUDA_SUCCESS"; break;
        case INVALID_VALUE: *name = "CUDA_ERROR_INVALID_VALUE"; break;
        case OUT_OF_MEMORY: *name = "CUDA_ERROR_OUT_OF_MEMORY"; break;
        case NOT_INITIALIZED: *name = "CUDA_ERROR_NOT_INITIALIZED"; break;
        case NO_DEVICE: *name = "CUDA_ERROR_NO_DEVICE"; break;
        case INVALID_DEVICE: *name = "CUDA_ERROR_INVALID_DEVICE"; break;
        case INVALID_CONTEXT: *name = "CUDA_ERROR_INVALID_CONTEXT"; break;
        case NO_BINARY_FOR_GPU: *name = "CUDA_ERROR_NO_BINARY_FOR_GPU"; break;
        case INVALID_PTX: *name = "CUDA_ERROR_INVALID_PTX"; break;
        case UNSUPPORTED_PTX_VERSION: *name = "CUDA_ERROR_UNSUPPORTED_PTX_VERSION"; break;
        case INVALID_HANDLE: *name = "CUDA_ERROR_INVALID_HANDLE"; break;
        case NOT_FOUND: *name = "CUDA_ERROR_NOT_FOUND"; break;
        case NOT_READY: *name = "CUDA_ERROR_NOT_READY"; break;
        case ILLEGAL_ADDRESS: *name = "CUDA_ERROR_ILLEGAL_ADDRESS"; break;
        case LAUNCH_FAILED: *name = "CUDA_ERROR_LAUNCH_FAILED"; break;
        case NOT_SUPPORTED: *name = "CUDA_ERROR_NOT_SUPPORTED"; break;
        case UNKNOWN: *name = "CUDA_ERROR_UNKNOWN"; break;
        case 46: *name = "CUDA_ERROR_DEVICE_UNAVAILABLE"; break;
        case 701: *name = "CUDA_ERROR_LAUNCH_OUT_OF_RESOURCES"; break;
        case 803: *name = "CUDA_ERROR_SYSTEM_DRIVER_MISMATCH"; break;
        // As a driver for unknown codes.
        default: *name = nullptr; return INVALID_VALUE;
    }
    return SUCCESS;
}

CUresult cuGetErrorString(CUresult code, const char **text) {
    static thread_local char buffer[64];
    std::snprintf(buffer, sizeof buffer, "emulated error %d", code);
    *text = buffer;
    return SUCCESS;
}

}  // extern "C"
