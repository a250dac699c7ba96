# Linux on 64-bit RISC-V. -DCMAKE_SYSROOT=FOLDER names the folder with its libraries (scripts/sysroot riscv64 FOLDER).
set(CMAKE_SYSTEM_PROCESSOR riscv64)
include(${CMAKE_CURRENT_LIST_DIR}/linux-gnu.cmake)
