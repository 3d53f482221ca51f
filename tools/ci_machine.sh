# What .ci/run needs of this or that machine; it is sourced there, with `work` and `say` defined.
# As root, what the system lacks is installed, and everything else runs as `nobody`; else all runs as who it is.
# Defines as_user, give, install, check and python.

has_library() { ldconfig -p | grep "$1" >/dev/null; } # not -q: ldconfig would fail at the closed pipe
has_browser() {
    for name in chromium chromium-browser google-chrome; do
        if "$name" --version >/dev/null 2>&1; then return 0; fi
    done
    return 1
}
can_install() { [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; }
apt_install() { DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null; }

if [ "$(id -u)" -eq 0 ]; then
    home="$work/home" path=/usr/local/bin:/usr/bin:/bin
    mkdir -p "$home/.config"
    if [ -d ~/.config/pip ]; then cp -r ~/.config/pip "$home/.config"; fi # where packages come from
    chmod 755 "$work"
    chown -R nobody "$home" # caches too: without them matplotlib looks through the fonts in every process
    # as_user [NAME=VALUE ...] COMMAND ...
    as_user() { runuser -u nobody -- env -i HOME="$home" PATH="$path" "$@"; }
    give() { chown -R nobody "$@"; }
else
    as_user() { env -i HOME="$HOME" PATH="$PATH" "$@"; }
    give() { :; }
fi

# Rendering needs a GL library; everything else runs without, so a machine that cannot get one still runs the rest.
# OSMesa and a virtual screen are wanted by one test each.
if ! { has_library libEGL.so.1 && has_library libGL.so.1 && has_library libOSMesa.so && command -v Xvfb >/dev/null; }; then
    { can_install && apt-get update -qq && apt_install libegl1 libgl1 libosmesa6 xvfb; } ||
        say "no EGL, GL, OSMesa or Xvfb, and they could not be installed; tests that render say so"
fi
# Some tests open the report and the interactive page in a browser: 120 MB, some 20 s. A slow mirror must not hold up the rest, and Ubuntu has only
# a snap under this name.
fetch_browser() {
    timeout 60 apt-get update -qq && timeout 90 apt-get install -y -qq --no-install-recommends --download-only chromium
}
if ! has_browser && can_install; then
    { fetch_browser >/dev/null && apt_install chromium; } || true
fi
required=(KINREACH_REQUIRE_GL=1) # tests that draw must run here, not be skipped; from all others OpenGL is hidden (tests/machine.py)
if has_browser; then
    required+=(KINREACH_REQUIRE_BROWSER=1)
else
    say "no chromium, and it could not be installed; the tests that open a browser are skipped"
fi

if [ -n "${KINREACH_WARP_CACHE:-}" ]; then # a folder for the kernels of Warp, which take minutes to compile, from run to run
    mkdir -p "$KINREACH_WARP_CACHE"
    give "$KINREACH_WARP_CACHE"
    required+=("WARP_CACHE_PATH=$KINREACH_WARP_CACHE")
fi

# A Python that the user may run: the one in PATH can lie under a home folder that is closed to others.
usable() { [ -n "$1" ] && as_user "$1" -c 'import ensurepip, sys; assert sys.version_info >= (3, 11)' 2>/dev/null; }
find_python() {
    for python in "$(command -v python3.11)" /usr/bin/python3.11; do
        if usable "$python"; then return; fi
    done
    return 1
}
if ! find_python; then
    { can_install && apt-get update -qq && apt_install python3.11-venv && find_python; } || {
        say "no Python 3.11 with venv that an ordinary user may run, and it could not be installed"
        exit 1
    }
fi

# Only set-up gets what says how this machine reaches the packages.
mapfile -t network < <(env | grep -E '^(PIP_\w+|\w*(CERT|CA_BUNDLE)\w*|\w+_(proxy|PROXY))=' || true)
install() { as_user "${network[@]}" PIP_QUIET=2 PIP_DISABLE_PIP_VERSION_CHECK=1 "$@"; }
check() {
    say "$*"
    as_user "${required[@]}" "$@"
}
