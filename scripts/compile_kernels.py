"""Compiles every .cu under pipeline/ to pipeline/ptx/NAME.ptx and assembles it to pipeline/ptx/NAME.sm_XX.cubin; run by scripts/ptx.

Constants shared with Rust are defined once, in Rust: a line `// From cuda.rs: THREADS, TILES` of a .cu defines THREADS and TILES as
the literals of `const THREADS: usize = 256;` etc. in that file (a path relative to the .cu).
"""

import ctypes
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

TARGET = "compute_80"
# Architectures of the cubins, by the assembler that makes them: that of the oldest driver that supports the architecture.
OLDER = ["sm_80", "sm_86", "sm_89", "sm_90"]
NEWER = ["sm_100", "sm_120"]


def constants(source):
    """The constants that a .cu takes from Rust."""
    found = []
    for file, names in re.findall(r"^// From (\S+\.rs): (.+)$", source.read_text("utf-8"), re.M):
        rust = (source.parent / file).read_text("utf-8")
        for name in re.findall(r"\w+", names):
            value = re.search(rf"\bconst {name}: \w+ = ([0-9_]+(?:\.[0-9_]+)?);", rust)
            if not value:
                sys.exit(f"{source}: {file} has no `const {name}: TYPE = NUMBER;`")
            found.append(f"-D{name}={value[1].replace('_', '')}")
    return found


def compile_ptx(nvrtc, source):
    """The PTX of a .cu."""
    program, size = ctypes.c_void_p(), ctypes.c_size_t()
    text = source.read_bytes()
    nvrtc.nvrtcCreateProgram(ctypes.byref(program), text, source.name.encode(), 0, None, None)
    options = [f"--gpu-architecture={TARGET}", "--std=c++17", f"--include-path={source.parent}", *constants(source)]
    array = (ctypes.c_char_p * len(options))(*[o.encode() for o in options])
    failed = nvrtc.nvrtcCompileProgram(program, len(options), array)
    nvrtc.nvrtcGetProgramLogSize(program, ctypes.byref(size))
    log = ctypes.create_string_buffer(size.value)
    nvrtc.nvrtcGetProgramLog(program, log)
    if failed or log.value.strip():
        sys.exit(f"{source}: {log.value.decode().strip() or 'NVRTC fails without a message'}")
    nvrtc.nvrtcGetPTXSize(program, ctypes.byref(size))
    ptx = ctypes.create_string_buffer(size.value)
    nvrtc.nvrtcGetPTX(program, ptx)
    # Without the declarations of a header of the compiler, which are not used.
    text = b"\n".join(line for line in ptx.value.split(b"\n") if b"2nv6target" not in line)
    # Explicit rounding prevents the driver's assembler from fusing multiplication and addition, in which drivers may differ.
    return re.sub(rb"\b(add|sub|mul)\.(f32|f64)\b", rb"\1.rn.\2", text)


def assemble(ptxas, ptx, architecture, cubin):
    """(kernel, registers, stack bytes, spilled bytes) of every kernel on an architecture; writes the binary to `cubin`."""
    command = [ptxas, "-v", f"-arch={architecture}", ptx, "-o", cubin]
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode:
        sys.exit(f"{ptx} on {architecture}: {run.stderr}")
    figures = re.findall(
        r"Compiling entry function '(\w+)'.*?(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads"
        r".*?Used (\d+) registers",
        run.stderr,
        re.S,
    )
    entries = re.findall(r"\.entry (\w+)", pathlib.Path(ptx).read_text("utf-8"))
    if sorted(name for name, *_ in figures) != sorted(entries):
        sys.exit(f"{ptx} on {architecture}: figures are missing for some kernels in\n{run.stderr}")
    return [(name, int(registers), int(stack), int(a) + int(b)) for name, stack, a, b, registers in figures]


def main():
    place, check = pathlib.Path(sys.argv[1]), "--check" in sys.argv
    nvrtc = ctypes.CDLL(str(place / "12.2/nvidia/cuda_nvrtc/lib/libnvrtc.so.12"))
    assemblers = [(v, place / v / "nvidia/cuda_nvcc/bin/ptxas") for v in ("12.2", "12.9")]
    wrong, table = [], {}
    scratch = pathlib.Path(tempfile.mkdtemp())
    for source in sorted(pathlib.Path("pipeline").rglob("*.cu")):
        there, fresh = pathlib.Path("pipeline/ptx", source.stem + ".ptx"), compile_ptx(nvrtc, source)
        if check and (not there.exists() or there.read_bytes() != fresh):
            problem = "differs from the output of its source" if there.exists() else "is missing"
            wrong.append(f"{there} {problem}: run scripts/ptx")
            continue
        if not check:
            there.write_bytes(fresh)
        for version, ptxas in assemblers:
            for architecture in OLDER + (NEWER if version != "12.2" else []):
                assembled = scratch / "cubin"
                kernels = assemble(ptxas, there, architecture, assembled)
                # Tests load their kernels as PTX.
                if source.stem != "probe" and (architecture in NEWER or version == "12.2"):
                    cubin = there.with_suffix(f".{architecture}.cubin")
                    if not check:
                        cubin.write_bytes(assembled.read_bytes())
                    elif not cubin.exists() or cubin.read_bytes() != assembled.read_bytes():
                        wrong.append(f"{cubin} differs from the output of the assembler, or is missing: run scripts/ptx")
                for name, registers, stack, spilled in kernels:
                    table.setdefault(name, {})[version, architecture] = registers
                    if stack or spilled:
                        wrong.append(f"{name} on {architecture} ({version}): {stack} bytes of stack, {spilled} spilled")
    columns = [("12.2", a) for a in OLDER] + [("12.9", a) for a in OLDER + NEWER]
    width = max([len(name) for name in table] or [0])
    print("registers".ljust(width), *(f"{a[3:]}" + ("'" if v == "12.9" else "") for v, a in columns), sep="\t")
    for name, of in sorted(table.items()):
        print(name.ljust(width), *(of.get(c, "-") for c in columns), sep="\t")
    shutil.rmtree(scratch)
    print("' by the assembler of 12.9, else of 12.2")
    for line in wrong:
        print(line, file=sys.stderr)
    # Without --check, spilling is reported only.
    sys.exit(1 if wrong and check else 0)


main()
