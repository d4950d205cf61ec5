// Memory of the emulated driver: device memory is allocated on the heap, where AddressSanitizer checks it, and filled with NaN; every
// copy must be within one live allocation.
//
// As on a device, a copy between the device and memory that is not pinned is complete for the caller when the call returns (upload:
// the values are copied at once; download: waits for the stream); memory freed in stream order is free when the stream reaches that
// point.
#include "driver.h"
#include <cstdlib>

namespace emulated {

bool Device::holds(uintptr_t from, size_t bytes) const {
    auto after = live.upper_bound(from);
    if (after == live.begin()) return false;
    auto in = std::prev(after);
    return from - in->first <= in->second && bytes <= in->second - (from - in->first);
}

// Page-locked host memory of all devices.
static std::mutex host_lock;
static std::map<uintptr_t, size_t> host;

bool pinned(const void *at, size_t bytes) {
    std::lock_guard<std::mutex> guard(host_lock);
    auto after = host.upper_bound(reinterpret_cast<uintptr_t>(at));
    if (after == host.begin()) return false;
    auto in = std::prev(after);
    const size_t offset = reinterpret_cast<uintptr_t>(at) - in->first;
    return offset <= in->second && bytes <= in->second - offset;
}

bool idle() {
    static const bool none = setting("WORK") && !std::strcmp(setting("WORK"), "none");
    return none;
}

static CUresult check(Device &d, CUdeviceptr at, size_t bytes, const char *doing) {
    if (d.holds(at, bytes)) return SUCCESS;
    return wrong(INVALID_VALUE, "%s of %zu bytes at %#llx: not within an allocation of device %d", doing, bytes, at, d.index);
}

static CUresult allocate(Device &d, CUdeviceptr *at, size_t bytes) {
    if (fails("memory", d.index, ++d.allocations)) return OUT_OF_MEMORY;
    if (bytes > d.memory - d.used) {
        // Memory freed in stream order may become free.
        const CUresult error = drain_all(d);
        if (error) return error;
    }
    if (bytes > d.memory - d.used) return OUT_OF_MEMORY;
    void *memory = nullptr;
    if (posix_memalign(&memory, 256, bytes)) return OUT_OF_MEMORY;
    std::memset(memory, 0xff, bytes);
    *at = reinterpret_cast<uintptr_t>(memory);
    d.live[*at] = bytes;
    d.used += bytes;
    d.peak = std::max(d.peak, d.used);
    return SUCCESS;
}

static CUresult release(Device &d, CUdeviceptr at) {
    auto found = d.live.find(at);
    if (found == d.live.end()) return wrong(INVALID_VALUE, "%#llx is freed, but was not allocated on device %d", at, d.index);
    d.used -= found->second;
    d.live.erase(found);
    std::free(reinterpret_cast<void *>(at));
    return SUCCESS;
}

static CUresult up(CUdeviceptr to, const void *from, size_t bytes, CUstream handle) {
    Current c;
    if (c.error) return c.error;
    Device &d = *c.device;
    auto stream = d.stream(handle);
    if (!stream) return INVALID_HANDLE;
    if (CUresult error = check(d, to, bytes, "a copy to the device")) return error;
    std::shared_ptr<std::vector<char>> copied;
    if (!pinned(from, bytes)) {
        const char *first = static_cast<const char *>(from);
        copied = std::make_shared<std::vector<char>>(first, first + bytes);
    }
    return enqueue(stream, {[=, &d] {
        if (CUresult error = check(d, to, bytes, "a copy to the device")) return error;
        if (!idle()) std::memcpy(reinterpret_cast<void *>(to), copied ? copied->data() : from, bytes);
        d.up += bytes;
        return CUresult(SUCCESS);
    }, nullptr});
}

static CUresult down(void *to, CUdeviceptr from, size_t bytes, CUstream handle) {
    Current c;
    if (c.error) return c.error;
    Device &d = *c.device;
    auto stream = d.stream(handle);
    if (!stream) return INVALID_HANDLE;
    if (CUresult error = check(d, from, bytes, "a copy from the device")) return error;
    CUresult error = enqueue(stream, {[=, &d] {
        if (CUresult error = check(d, from, bytes, "a copy from the device")) return error;
        if (!idle()) std::memcpy(to, reinterpret_cast<const void *>(from), bytes);
        d.down += bytes;
        return CUresult(SUCCESS);
    }, nullptr});
    return error || pinned(to, bytes) ? error : drain(*stream, stream->enqueued);
}

static CUresult on_device(CUdeviceptr to, size_t bytes, CUstream handle, const char *doing, std::function<void()> run) {
    Current c;
    if (c.error) return c.error;
    Device &d = *c.device;
    auto stream = d.stream(handle);
    if (!stream) return INVALID_HANDLE;
    if (CUresult error = check(d, to, bytes, doing)) return error;
    return enqueue(stream, {[=, &d] {
        if (CUresult error = check(d, to, bytes, doing)) return error;
        if (!idle()) run();
        return CUresult(SUCCESS);
    }, nullptr});
}

}  // namespace emulated

using namespace emulated;

extern "C" {

// Freed memory is always available to later allocations, so the attributes of a pool have no effect.
CUresult cuDeviceGetDefaultMemPool(void **pool, CUdevice device) {
    *pool = reinterpret_cast<void *>(uintptr_t(device) + 1);
    return SUCCESS;
}

CUresult cuMemPoolSetAttribute(void *pool, int attribute, void *) {
    return pool && attribute == 4 ? SUCCESS : INVALID_VALUE;
}

CUresult cuMemGetInfo_v2(size_t *free, size_t *total) {
    Current c;
    if (c.error) return c.error;
    *free = c.device->memory - c.device->used;
    *total = c.device->memory;
    return SUCCESS;
}

CUresult cuMemAlloc_v2(CUdeviceptr *at, size_t bytes) {
    Current c;
    if (c.error) return c.error;
    return bytes ? allocate(*c.device, at, bytes) : INVALID_VALUE;
}

CUresult cuMemAllocAsync(CUdeviceptr *at, size_t bytes, CUstream handle) {
    Current c;
    if (c.error) return c.error;
    if (!c.device->stream(handle)) return INVALID_HANDLE;
    *at = 0;
    return bytes ? allocate(*c.device, at, bytes) : SUCCESS;
}

CUresult cuMemFree_v2(CUdeviceptr at) {
    Current c;
    if (c.error) return c.error;
    CUresult error = drain_all(*c.device);
    return error ? error : release(*c.device, at);
}

CUresult cuMemFreeAsync(CUdeviceptr at, CUstream handle) {
    Current c;
    if (c.error) return c.error;
    Device &d = *c.device;
    auto stream = d.stream(handle);
    if (!stream) return INVALID_HANDLE;
    return at ? enqueue(stream, {[=, &d] { return release(d, at); }, nullptr}) : SUCCESS;
}

CUresult cuMemHostAlloc(void **at, size_t bytes, unsigned) {
    Current c;
    if (c.error) return c.error;
    if (fails("host-memory", c.device->index, ++c.device->host_allocations)) return OUT_OF_MEMORY;
    if (posix_memalign(at, 4096, std::max<size_t>(bytes, 1))) return OUT_OF_MEMORY;
    std::memset(*at, 0xff, bytes);
    std::lock_guard<std::mutex> guard(host_lock);
    host[reinterpret_cast<uintptr_t>(*at)] = bytes;
    return SUCCESS;
}

// Also after the device is lost.
CUresult cuMemFreeHost(void *at) {
    Current c;
    if (!c.error) drain_all(*c.device);
    std::lock_guard<std::mutex> guard(host_lock);
    if (!host.erase(reinterpret_cast<uintptr_t>(at))) return wrong(INVALID_VALUE, "host memory is freed that was not allocated");
    std::free(at);
    return c.error;
}

CUresult cuMemcpyHtoDAsync_v2(CUdeviceptr to, const void *from, size_t bytes, CUstream stream) {
    return up(to, from, bytes, stream);
}

CUresult cuMemcpyDtoHAsync_v2(void *to, CUdeviceptr from, size_t bytes, CUstream stream) {
    return down(to, from, bytes, stream);
}

CUresult cuMemcpyHtoD_v2(CUdeviceptr to, const void *from, size_t bytes) {
    CUresult error = up(to, from, bytes, nullptr);
    Current c;
    return error ? error : drain(*c.device->standard, c.device->standard->enqueued);
}

CUresult cuMemcpyDtoH_v2(void *to, CUdeviceptr from, size_t bytes) {
    CUresult error = down(to, from, bytes, nullptr);
    Current c;
    return error ? error : drain(*c.device->standard, c.device->standard->enqueued);
}

CUresult cuMemcpyDtoDAsync_v2(CUdeviceptr to, CUdeviceptr from, size_t bytes, CUstream stream) {
    {
        Current c;
        if (c.error) return c.error;
        if (CUresult error = check(*c.device, from, bytes, "a copy on the device")) return error;
    }
    return on_device(to, bytes, stream, "a copy on the device", [=] {
        std::memmove(reinterpret_cast<void *>(to), reinterpret_cast<const void *>(from), bytes);
    });
}

CUresult cuMemsetD8Async(CUdeviceptr to, unsigned char value, size_t bytes, CUstream stream) {
    return on_device(to, bytes, stream, "a fill", [=] { std::memset(reinterpret_cast<void *>(to), value, bytes); });
}

CUresult cuMemsetD32Async(CUdeviceptr to, unsigned value, size_t count, CUstream stream) {
    return on_device(to, 4 * count, stream, "a fill", [=] {
        std::fill_n(reinterpret_cast<unsigned *>(to), count, value);
    });
}

}  // extern "C"
