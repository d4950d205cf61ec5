# Sourced by the checks, from the project's root: records steps and skipped checks.
# shellcheck shell=bash
#
# LENSCUBE_CHECK_REPORT, set by scripts/check, is the path of a file of lines `step TAB state TAB seconds TAB reason`; without it a check
# only prints. States: ran, failed, skipped. A reason starting with "unavailable: " is a requirement that cannot be installed here.

in_ci() { [ "${CI:-false}" != false ] && [ "${CI:-}" != 0 ]; }

# record STEP STATE SECONDS [REASON]
record() {
    if [ -n "${LENSCUBE_CHECK_REPORT:-}" ]; then
        printf '%s\t%s\t%s\t%s\n' "$1" "$2" "$3" "${4:-}" >>"$LENSCUBE_CHECK_REPORT"
    fi
}

# skipped_part NAME REASON: records that a part of a check is skipped. An error in CI unless the requirement is unavailable.
skipped_part() {
    echo "$1: SKIPPED: $2" >&2
    record "$1" skipped "" "$2"
    case $2 in unavailable:*) return 0 ;; esac
    ! in_ci || { echo "$1: must run in CI" >&2; return 1; }
}

# skipped REASON: records that the check is skipped, and exits.
skipped() {
    skipped_part "$(basename "$0")" "$*" || exit 1
    exit 0
}

# ensure_program PROGRAM PACKAGE...: installs PROGRAM if it is missing, by apt-get (Debian and derivatives, as root).
ensure_program() {
    local program=$1
    shift
    command -v "$program" >/dev/null && return
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        { apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$@"; } >/dev/null 2>&1 || true
    fi
    command -v "$program" >/dev/null
}

# node_20: checks that node >= 20 and npm are installed; else sets `node_lacks` to the reason.
node_20() {
    node_lacks="node and npm are not installed"
    ensure_program node nodejs && ensure_program npm npm || return 1
    node_lacks="node is older than 20: $(node --version)"
    [ "$(node -p 'process.versions.node.split(".")[0]')" -ge 20 ]
}

# Prints the path of Chromium.
find_chromium() {
    local name
    for name in chromium chromium-browser google-chrome-stable google-chrome; do
        command -v "$name" && return
    done
    return 1
}
