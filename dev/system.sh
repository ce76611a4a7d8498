#!/bin/sh
# Install what the system lacks, on a machine that is ours to change (root, apt); any other is left
# as it is. What cannot be done without ends it in a sentence.
#
#     sh dev/system.sh PYTHON setup      a module that makes environments, and OpenGL if it can be had
#     sh dev/system.sh PYTHON test       the same, OpenGL must be there, and Vulkan if it can be had
#     sh dev/system.sh PYTHON browser    a browser if it can be had, for tests of driven pages
#     sh dev/system.sh PYTHON hardware   what a library of cameras loads, if it can be had
set -eu
python=$1
part=$2
vulkan="libvulkan1 mesa-vulkan-drivers"
opengl="libegl1 libopengl0 libgl1 libgl1-mesa-dri"

loads() {
    "$python" -c 'import ctypes, sys; ctypes.CDLL(sys.argv[1])' "$1" 2>/dev/null
}

has_opengl() {
    loads libEGL.so.1 || loads libOSMesa.so.8
}

has_venv() {
    "$python" -c 'import ensurepip, venv' 2>/dev/null
}

has_browser() {
    command -v chromium || command -v chromium-browser || command -v google-chrome
} >/dev/null

venv=$("$python" -c 'import sys; print("python{}.{}-venv".format(*sys.version_info))')
packages=""
has_venv || packages="$packages $venv"
has_opengl || packages="$packages $opengl"
if [ "$part" = test ]; then
    loads libvulkan.so.1 || packages="$packages $vulkan"
fi
if [ "$part" = browser ]; then
    has_browser || packages="$packages chromium"
fi
if [ "$part" = hardware ]; then
    loads libusb-1.0.so.0 || packages="$packages libusb-1.0-0"
fi

if [ -n "$packages" ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    export DEBIAN_FRONTEND=noninteractive
    apt-get update || true
    # Each word is a package.
    # shellcheck disable=SC2086
    apt-get install --yes --no-install-recommends $packages || true
fi

if ! has_venv; then
    echo "$python cannot make environments here; as root: apt-get install $venv" >&2
    exit 1
fi
if [ "$part" = test ] && ! has_opengl; then
    echo "The tests render images, but OpenGL is missing; as root: apt-get install $opengl" >&2
    exit 1
fi
