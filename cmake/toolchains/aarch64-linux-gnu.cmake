# Linux on 64-bit ARM. -DCMAKE_SYSROOT=FOLDER names the folder with its libraries (scripts/sysroot arm64 FOLDER).
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(LIEGRAD_QEMU_OPTIONS -cpu cortex-a72) # ARMv8.0 and no more, as on a Raspberry Pi 4
include(${CMAKE_CURRENT_LIST_DIR}/linux-gnu.cmake)
