// Modules and launches of the emulated driver. Version, target, and entries with their parameters, maximum threads and static shared
// memory are read from the PTX, architecture, names and static shared memory from a cubin; the kernels themselves are compiled into this library.
#include "driver.h"
#include "block.h"
#include <elf.h>
#include <regex>
#include <thread>

namespace emulated {

static std::map<std::string, Kernel> &kernels() {
    static auto *all = new std::map<std::string, Kernel>;
    return *all;
}

void add(const char *name, Kernel kernel) { kernels()[name] = std::move(kernel); }

// The newest PTX version (times 10) that a driver accepts.
static int newest_ptx() {
    const int major = driver_version() / 1000, minor = driver_version() % 1000 / 10;
    if (major <= 11) return 70 + minor;
    const int of_12[] = {80, 81, 82, 83, 84, 85, 85, 86, 87, 88};
    return major == 12 ? of_12[std::min(minor, 9)] : 90 + minor;
}

// Bytes of a parameter such as `.param .align 4 .b8 name[12]` or `.param .u64 name`.
static size_t parameter_bytes(const std::string &text) {
    std::smatch m;
    if (std::regex_search(text, m, std::regex(R"(\.[bfsu](\d+)\s+\w+\s*\[(\d+)\])"))) return std::stoul(m[1]) / 8 * std::stoul(m[2]);
    if (std::regex_search(text, m, std::regex(R"(\.[bfsu](\d+)\s)"))) return std::stoul(m[1]) / 8;
    return 0;
}

static size_t total_static_shared(const std::string &ptx) {
    size_t bytes = 0;
    const std::regex array(R"(\.shared\s+\.align\s+\d+\s+\.[bfsu](\d+)\s+\w+\[(\d+)\])");
    for (std::sregex_iterator i(ptx.begin(), ptx.end(), array), end; i != end; ++i)
        bytes += std::stoul((*i)[1]) / 8 * std::stoul((*i)[2]);
    return bytes;
}

// An entry: parameters, and directives between its parameters and its body.
static CUresult entry(Device &d, Module &module, const std::string &name, const std::string &parameters, const std::string &rest, size_t shared) {
    auto kernel = kernels().find(name);
    if (kernel == kernels().end()) return wrong(INVALID_PTX, "the PTX's %s is not among the kernels built for the CPU", name.c_str());
    std::vector<size_t> sizes;
    const std::regex parameter(R"(\.param[^,]*)");
    for (std::sregex_iterator i(parameters.begin(), parameters.end(), parameter), end; i != end; ++i)
        sizes.push_back(parameter_bytes(i->str()));
    if (sizes != kernel->second.sizes)
        return wrong(INVALID_PTX, "the parameters of %s are not those of its source: run scripts/ptx", name.c_str());
    std::smatch m;
    const size_t max_threads = std::regex_search(rest, m, std::regex(R"(\.maxntid\s+(\d+),\s*(\d+),\s*(\d+))"))
                            ? std::stoul(m[1]) * std::stoul(m[2]) * std::stoul(m[3]) : 1024;
    module.functions[name].reset(new Function{name, &d, &kernel->second, max_threads, shared, 49152 - std::min<size_t>(shared, 49152)});
    return SUCCESS;
}

static CUresult load(Device &d, Module &module, const std::string &ptx) {
    std::smatch m;
    if (!std::regex_search(ptx, m, std::regex(R"(\.version\s+(\d+)\.(\d+))"))) return INVALID_PTX;
    if (std::stoi(m[1]) * 10 + std::stoi(m[2]) > newest_ptx()) return UNSUPPORTED_PTX_VERSION;
    if (!std::regex_search(ptx, m, std::regex(R"(\.target\s+sm_(\d+))"))) return INVALID_PTX;
    if (std::stoi(m[1]) > 10 * d.major + d.minor) return NO_BINARY_FOR_GPU;
    const size_t shared = total_static_shared(ptx);
    for (size_t at = 0; (at = ptx.find(".entry ", at)) != std::string::npos; ++at) {
        const size_t open = ptx.find('(', at), close = ptx.find(')', open), body = ptx.find('{', close);
        std::string name = ptx.substr(at + 7, open - at - 7);
        name.erase(name.find_last_not_of(" \t\r\n") + 1);
        CUresult error = entry(d, module, name, ptx.substr(open, close - open), ptx.substr(close, body - close), shared);
        if (error) return error;
    }
    return SUCCESS;
}

// A cubin: an ELF file whose sections .text.NAME are kernels and .nv.shared.NAME their static shared memory. The architecture stands in the flags,
// bits 0 to 7, or 8 to 15 since ABI version 8; it must have the device's major number and not be newer.
static CUresult load_cubin(Device &d, Module &module, const char *image) {
    if (!setting("CUBINS")) return NO_BINARY_FOR_GPU;
    const auto &header = *reinterpret_cast<const Elf64_Ehdr *>(image);
    const int architecture = header.e_flags >> (header.e_ident[EI_ABIVERSION] < 8 ? 0 : 8) & 0xff;
    if (architecture / 10 != d.major || architecture % 10 > d.minor) return NO_BINARY_FOR_GPU;
    const auto *sections = reinterpret_cast<const Elf64_Shdr *>(image + header.e_shoff);
    const char *names = image + sections[header.e_shstrndx].sh_offset;
    auto named = [&](int k, const std::string &prefix) {
        const std::string name = names + sections[k].sh_name;
        return name.compare(0, prefix.size(), prefix) ? std::string() : name.substr(prefix.size());
    };
    for (int k = 0; k < header.e_shnum; ++k) {
        const std::string name = named(k, ".text.");
        if (name.empty()) continue;
        auto kernel = kernels().find(name);
        if (kernel == kernels().end()) return wrong(INVALID_IMAGE, "the cubin's %s is not among the kernels built for the CPU", name.c_str());
        size_t shared = 0;
        for (int j = 0; j < header.e_shnum; ++j)
            if (named(j, ".nv.shared.") == name) shared = sections[j].sh_size;
        module.functions[name].reset(new Function{name, &d, &kernel->second, 1024, shared, 49152 - std::min<size_t>(shared, 49152)});
    }
    return module.functions.empty() ? INVALID_IMAGE : SUCCESS;
}

static CUresult check(const Function &f, dim3 grid, dim3 block, size_t shared) {
    const size_t threads = size_t(block.x) * block.y * block.z;
    const char *name = f.name.c_str();
    if (!threads || !grid.x || !grid.y || !grid.z) return wrong(INVALID_VALUE, "%s: launched without blocks or threads", name);
    if (threads > f.max_threads || block.x > 1024 || block.y > 1024 || block.z > 64)
        return wrong(INVALID_VALUE, "%s: %u x %u x %u threads, at most %zu", name, block.x, block.y, block.z, f.max_threads);
    if (grid.x > 0x7fffffff || grid.y > 65535 || grid.z > 65535)
        return wrong(INVALID_VALUE, "%s: %u x %u x %u blocks are too many", name, grid.x, grid.y, grid.z);
    if (shared > f.max_dynamic)
        return wrong(INVALID_VALUE, "%s: %zu bytes of dynamic shared memory, %zu are allowed", name, shared, f.max_dynamic);
    return SUCCESS;
}

static CUresult execute(Device &d, const Function &f, dim3 grid, dim3 block, size_t shared, const Call &call) {
    const char *error = idle() ? nullptr : run(grid, block, shared, call);
    wait_until_lost(d);
    if (d.delay_us) std::this_thread::sleep_for(std::chrono::microseconds(d.delay_us));
    return error ? wrong(LAUNCH_FAILED, "%s: %s", f.name.c_str(), error) : SUCCESS;
}

}  // namespace emulated

using namespace emulated;

extern "C" {

CUresult cuModuleLoadData(CUmodule *handle, const void *image) {
    Current c;
    if (c.error) return c.error;
    auto module = std::make_unique<Module>();
    const char *bytes = static_cast<const char *>(image);
    const bool is_cubin = !std::memcmp(bytes, ELFMAG, SELFMAG);
    if (CUresult error = is_cubin ? load_cubin(*c.device, *module, bytes) : load(*c.device, *module, bytes)) return error;
    *handle = reinterpret_cast<CUmodule>(module.get());
    c.device->modules[module.get()] = std::move(module);
    return SUCCESS;
}

CUresult cuModuleUnload(CUmodule handle) {
    Current c;
    if (c.error) return c.error;
    if (CUresult error = drain_all(*c.device)) return error;
    return c.device->modules.erase(handle) ? SUCCESS : INVALID_HANDLE;
}

CUresult cuModuleGetFunction(CUfunction *handle, CUmodule module, const char *name) {
    Current c;
    if (c.error) return c.error;
    auto found = c.device->modules.find(module);
    if (found == c.device->modules.end()) return INVALID_HANDLE;
    auto function = found->second->functions.find(name);
    if (function == found->second->functions.end()) return NOT_FOUND;
    *handle = reinterpret_cast<CUfunction>(function->second.get());
    return SUCCESS;
}

CUresult cuFuncGetAttribute(int *value, int attribute, CUfunction handle) {
    const Function &f = *reinterpret_cast<Function *>(handle);
    switch (attribute) {
        case 0: *value = int(f.max_threads); break;
        case 1: *value = int(f.static_shared); break;
        case 2: case 3: *value = 0; break;       // constant, local memory
        case 4: *value = 32; break;              // registers
        case 5: case 6: *value = 80; break;      // PTX, binary version
        case 8: *value = int(f.max_dynamic); break;
        default: return wrong(INVALID_VALUE, "function attribute %d is not emulated", attribute);
    }
    return SUCCESS;
}

CUresult cuFuncSetAttribute(CUfunction handle, int attribute, int value) {
    Current c;
    if (c.error) return c.error;
    Function &f = *reinterpret_cast<Function *>(handle);
    if (attribute == 9) return SUCCESS;          // how the cache is shared out
    if (attribute != 8) return wrong(INVALID_VALUE, "function attribute %d is not emulated", attribute);
    if (value < 0 || f.static_shared + value > c.device->shared_limit())
        return wrong(INVALID_VALUE, "%s: %d bytes of dynamic shared memory, device %d has %zu", f.name.c_str(), value, c.device->index, c.device->shared_limit());
    f.max_dynamic = value;
    return SUCCESS;
}

CUresult cuFuncSetCacheConfig(CUfunction, int) { return Current().error; }

// By threads and shared memory; registers are not emulated.
CUresult cuOccupancyMaxActiveBlocksPerMultiprocessorWithFlags(int *count, CUfunction handle, int threads, size_t dynamic, unsigned) {
    Current c;
    if (c.error) return c.error;
    const Function &f = *reinterpret_cast<Function *>(handle);
    const size_t shared = f.static_shared + dynamic + 1024, all = c.device->shared_limit() + 1024;
    *count = threads <= 0 ? 0 : int(std::min<size_t>(2048 / threads, all / shared));
    return SUCCESS;
}

CUresult cuOccupancyMaxActiveBlocksPerMultiprocessor(int *count, CUfunction handle, int threads, size_t dynamic) {
    return cuOccupancyMaxActiveBlocksPerMultiprocessorWithFlags(count, handle, threads, dynamic, 0);
}

CUresult cuLaunchKernel(CUfunction handle, unsigned gx, unsigned gy, unsigned gz, unsigned bx, unsigned by, unsigned bz, unsigned shared,
                        CUstream stream_handle, void **arguments, void **) {
    Current c;
    if (c.error) return c.error;
    Device &d = *c.device;
    const Function &f = *reinterpret_cast<Function *>(handle);
    auto stream = d.stream(stream_handle);
    if (!stream) return INVALID_HANDLE;
    if (f.device != &d) return wrong(INVALID_HANDLE, "%s is launched on device %d and was loaded for device %d", f.name.c_str(), d.index, f.device->index);
    const dim3 grid{gx, gy, gz}, block{bx, by, bz};
    if (CUresult error = check(f, grid, block, shared)) return error;
    const unsigned long n = ++d.launches;
    if (fails("refused", d.index, n)) return 701;
    if (fails("lost", d.index, n)) return enqueue(stream, {[&d] { return d.lost = UNKNOWN; }, nullptr, true});
    if (fails("kernel", d.index, n)) return enqueue(stream, {[&d] { return d.lost = ILLEGAL_ADDRESS; }, nullptr, true});
    if (const CUresult code = error_of_launch(d.index, n)) return enqueue(stream, {[&d, code] { return d.lost = code; }, nullptr, true});
    const Call call = f.kernel->bind(arguments);
    return enqueue(stream, {[=, &d, &f] { return execute(d, f, grid, block, shared, call); }, nullptr, true});
}

}  // extern "C"
