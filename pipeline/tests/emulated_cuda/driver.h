// State of the emulated driver: devices, their memory, streams of operations, events.
//
// Streams (EMULATED_CUDA_STREAMS):
//   eager     an operation runs when it is enqueued
//   deferred  an operation runs as late as possible: when something waits for it. Host memory is read and written late, which detects
//             reuse of a buffer before its copy has run, and a missing wait of a later operation
//   hasty     copies run as early as their waits allow, kernels as late as possible, which detects a copy that does not wait for
//             kernels that still use its memory
#pragma once
#include "cuda_cpu.h"
#include <atomic>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>

typedef int CUresult;
typedef int CUdevice;
typedef unsigned long long CUdeviceptr;
typedef struct Context *CUcontext;
typedef struct StreamHandle *CUstream;
typedef struct EventHandle *CUevent;
typedef struct ModuleHandle *CUmodule;
typedef struct FunctionHandle *CUfunction;

enum : CUresult {
    SUCCESS = 0, INVALID_VALUE = 1, OUT_OF_MEMORY = 2, NOT_INITIALIZED = 3, NO_DEVICE = 100, INVALID_DEVICE = 101,
    INVALID_IMAGE = 200, INVALID_CONTEXT = 201, NO_BINARY_FOR_GPU = 209, INVALID_PTX = 218, UNSUPPORTED_PTX_VERSION = 222, INVALID_HANDLE = 400,
    NOT_FOUND = 500, NOT_READY = 600, ILLEGAL_ADDRESS = 700, LAUNCH_FAILED = 719, NOT_SUPPORTED = 801, UNKNOWN = 999,
};

namespace emulated {

struct Device;
struct Stream;

// A point in a stream: a recorded event.
struct Mark {
    std::shared_ptr<Stream> stream;
    uint64_t at;
    double ms = 0;
    bool passed() const;
};

// An operation of a stream.
struct Operation {
    std::function<CUresult()> run;
    std::shared_ptr<Mark> waits;   // runs after this point
    bool kernel = false;
};

struct Stream {
    Device *device;
    std::deque<Operation> pending;
    uint64_t enqueued = 0, done = 0;   // number of operations
};

struct Event {
    bool timed;
    std::shared_ptr<Mark> mark;
};

struct Module;

struct Function {
    std::string name;
    Device *device;
    const Kernel *kernel;
    size_t max_threads, static_shared;
    size_t max_dynamic;
};

struct Module {
    std::map<std::string, std::unique_ptr<Function>> functions;
};

struct Device {
    int index = 0;
    std::recursive_mutex lock;
    int major = 9, minor = 0;
    size_t memory = 0, used = 0, peak = 0;
    std::atomic<CUresult> lost = SUCCESS;   // result of every call once the device is lost
    unsigned long launches = 0, allocations = 0, host_allocations = 0, up = 0, down = 0;
    int delay_us = 0;              // added to every kernel
    std::map<uintptr_t, size_t> live;
    std::map<void *, std::shared_ptr<Stream>> streams;
    std::map<void *, std::unique_ptr<Event>> events;
    std::map<void *, std::unique_ptr<Module>> modules;
    std::shared_ptr<Stream> standard;   // the null stream

    size_t shared_limit() const;
    std::shared_ptr<Stream> stream(CUstream handle);
    Event *event(CUevent handle);
    bool holds(uintptr_t from, size_t bytes) const;
};

// Prints an error of a call to stderr; returns `code`.
CUresult wrong(CUresult code, const char *format, ...) __attribute__((format(printf, 2, 3)));

// The device whose context is current on this thread, locked; or the error.
struct Current {
    Device *device;
    CUresult error;
    std::unique_lock<std::recursive_mutex> lock;
    Current();
};

CUresult enqueue(const std::shared_ptr<Stream> &stream, Operation operation);
CUresult drain(Stream &stream, uint64_t until);
CUresult drain_all(Device &device);
void release_all(Device &device);

// Whether the n-th operation of this kind on a device fails: EMULATED_CUDA_FAULTS=kind:device:n,...
bool fails(const char *kind, int device, unsigned long n);
// Result of the n-th launch of a device, or 0: EMULATED_CUDA_FAULTS=error-CODE:device:n,...
CUresult error_of_launch(int device, unsigned long n);
// Waits for the loss of the device of the setting UNTIL_LOST, unless `device` is that one.
void wait_until_lost(const Device &device);
const char *setting(const char *name);
// The i-th value of a list, or its last one.
double setting(const char *name, int i, double otherwise);
int driver_version();
bool pinned(const void *at, size_t bytes);
// EMULATED_CUDA_WORK=none: kernels, copies and fills do nothing, to time the host.
bool idle();

}  // namespace emulated
