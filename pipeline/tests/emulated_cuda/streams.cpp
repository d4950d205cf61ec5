// Streams and events of the emulated driver: order of operations (driver.h) and waits.
#include "driver.h"
#include <chrono>

namespace emulated {

enum class Mode { eager, deferred, hasty };

static Mode mode() {
    static const Mode chosen = [] {
        const char *name = setting("STREAMS");
        if (name && !std::strcmp(name, "deferred")) return Mode::deferred;
        if (name && !std::strcmp(name, "hasty")) return Mode::hasty;
        return Mode::eager;
    }();
    return chosen;
}

static double now_ms() {
    using namespace std::chrono;
    return duration<double, std::milli>(steady_clock::now().time_since_epoch()).count();
}

bool Mark::passed() const { return stream->done >= at; }

std::shared_ptr<Stream> Device::stream(CUstream handle) {
    if (!handle) return standard;
    auto found = streams.find(handle);
    if (found != streams.end()) return found->second;
    wrong(INVALID_HANDLE, "%p is not a stream of device %d", static_cast<void *>(handle), index);
    return nullptr;
}

Event *Device::event(CUevent handle) {
    auto found = events.find(handle);
    if (found != events.end()) return found->second.get();
    wrong(INVALID_HANDLE, "%p is not an event of device %d", static_cast<void *>(handle), index);
    return nullptr;
}

// Runs the first operation of a stream.
static CUresult step(Stream &stream) {
    Operation first = std::move(stream.pending.front());
    stream.pending.pop_front();
    CUresult error = stream.device->lost;
    if (!error && first.waits) error = drain(*first.waits->stream, first.waits->at);
    if (!error && first.run) error = first.run();
    if (error && error != INVALID_HANDLE) stream.device->lost = error;
    ++stream.done;
    return error;
}

CUresult drain(Stream &stream, uint64_t until) {
    while (stream.done < until)
        if (CUresult error = step(stream)) return error;
    return stream.device->lost;
}

// Mode hasty: runs all operations that are not kernels and need not wait, repeatedly while any was run.
static CUresult hurry(Device &d) {
    for (bool more = true; more;) {
        more = false;
        std::vector<std::shared_ptr<Stream>> all{d.standard};
        for (auto &s : d.streams) all.push_back(s.second);
        for (auto &s : all)
            while (!s->pending.empty() && !s->pending.front().kernel &&
                   (!s->pending.front().waits || s->pending.front().waits->passed())) {
                more = true;
                if (CUresult error = step(*s)) return error;
            }
    }
    return SUCCESS;
}

CUresult drain_all(Device &d) {
    // Newest stream first: streams may finish in any order.
    std::vector<std::shared_ptr<Stream>> all{d.standard};
    for (auto &s : d.streams) all.push_back(s.second);
    for (auto s = all.rbegin(); s != all.rend(); ++s)
        if (CUresult error = drain(**s, (*s)->enqueued)) return error;
    return d.lost;
}

CUresult enqueue(const std::shared_ptr<Stream> &stream, Operation operation) {
    stream->pending.push_back(std::move(operation));
    ++stream->enqueued;
    switch (mode()) {
        case Mode::eager: return drain(*stream, stream->enqueued);
        case Mode::hasty: return hurry(*stream->device);
        case Mode::deferred: return SUCCESS;
    }
    return SUCCESS;
}

// Waits on the host for a mark.
static CUresult reach(Device &d, const std::shared_ptr<Mark> &mark) {
    if (!mark) return d.lost;
    CUresult error = drain(*mark->stream, mark->at);
    return !error && mode() == Mode::hasty ? hurry(d) : error;
}

// Whether a mark is passed; runs one operation if not, as a device proceeds meanwhile.
static CUresult query(Device &d, const Mark &mark) {
    if (mark.passed()) return d.lost;
    CUresult error = step(*mark.stream);
    return error ? error : mark.passed() ? SUCCESS : NOT_READY;
}

}  // namespace emulated

using namespace emulated;

extern "C" {

CUresult cuStreamCreateWithPriority(CUstream *handle, unsigned flags, int) {
    Current c;
    if (c.error) return c.error;
    if (flags != 1) return wrong(NOT_SUPPORTED, "streams that wait for the null stream are not emulated");
    auto stream = std::make_shared<Stream>();
    stream->device = c.device;
    *handle = reinterpret_cast<CUstream>(stream.get());
    c.device->streams[stream.get()] = stream;
    return SUCCESS;
}

CUresult cuStreamCreate(CUstream *handle, unsigned flags) { return cuStreamCreateWithPriority(handle, flags, 0); }

CUresult cuCtxGetStreamPriorityRange(int *least, int *greatest) {
    *least = 0;
    *greatest = -5;
    return SUCCESS;
}

// Enqueued operations are still completed.
CUresult cuStreamDestroy_v2(CUstream handle) {
    Current c;
    if (!c.device) return c.error;
    auto stream = c.device->stream(handle);
    if (!stream) return INVALID_HANDLE;
    CUresult error = c.error ? c.error : drain(*stream, stream->enqueued);
    c.device->streams.erase(handle);
    return error;
}

CUresult cuStreamSynchronize(CUstream handle) {
    Current c;
    if (c.error) return c.error;
    auto stream = c.device->stream(handle);
    return stream ? reach(*c.device, std::make_shared<Mark>(Mark{stream, stream->enqueued})) : INVALID_HANDLE;
}

CUresult cuStreamQuery(CUstream handle) {
    Current c;
    if (c.error) return c.error;
    auto stream = c.device->stream(handle);
    return stream ? query(*c.device, Mark{stream, stream->enqueued}) : INVALID_HANDLE;
}

CUresult cuStreamWaitEvent(CUstream handle, CUevent event, unsigned) {
    Current c;
    if (c.error) return c.error;
    auto stream = c.device->stream(handle);
    Event *e = c.device->event(event);
    if (!stream || !e) return INVALID_HANDLE;
    return e->mark ? enqueue(stream, {nullptr, e->mark}) : SUCCESS;
}

CUresult cuLaunchHostFunc(CUstream handle, void (*call)(void *), void *data) {
    Current c;
    if (c.error) return c.error;
    auto stream = c.device->stream(handle);
    return stream ? enqueue(stream, {[=] { call(data); return CUresult(SUCCESS); }, nullptr}) : INVALID_HANDLE;
}

CUresult cuEventCreate(CUevent *handle, unsigned flags) {
    Current c;
    if (c.error) return c.error;
    auto event = std::make_unique<Event>();
    event->timed = !(flags & 2);
    *handle = reinterpret_cast<CUevent>(event.get());
    c.device->events[event.get()] = std::move(event);
    return SUCCESS;
}

CUresult cuEventDestroy_v2(CUevent handle) {
    Current c;
    if (!c.device) return c.error;
    c.device->events.erase(handle);
    return c.error;
}

CUresult cuEventRecord(CUevent handle, CUstream stream_handle) {
    Current c;
    if (c.error) return c.error;
    auto stream = c.device->stream(stream_handle);
    Event *event = c.device->event(handle);
    if (!stream || !event) return INVALID_HANDLE;
    auto mark = std::make_shared<Mark>(Mark{stream, stream->enqueued + 1});
    event->mark = mark;
    return enqueue(stream, {[=] { mark->ms = now_ms(); return CUresult(SUCCESS); }, nullptr});
}

CUresult cuEventSynchronize(CUevent handle) {
    Current c;
    if (c.error) return c.error;
    Event *event = c.device->event(handle);
    return event ? reach(*c.device, event->mark) : INVALID_HANDLE;
}

CUresult cuEventQuery(CUevent handle) {
    Current c;
    if (c.error) return c.error;
    Event *event = c.device->event(handle);
    if (!event) return INVALID_HANDLE;
    return event->mark ? query(*c.device, *event->mark) : SUCCESS;
}

CUresult cuEventElapsedTime(float *ms, CUevent from, CUevent to) {
    Current c;
    if (c.error) return c.error;
    Event *a = c.device->event(from), *b = c.device->event(to);
    if (!a || !b || !a->mark || !b->mark || !a->timed || !b->timed) return INVALID_HANDLE;
    if (!a->mark->passed() || !b->mark->passed()) return NOT_READY;
    *ms = float(b->mark->ms - a->mark->ms);
    return SUCCESS;
}

}  // extern "C"
