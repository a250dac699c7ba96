# Linux on 32-bit x86 with SSE2 (CMakeLists.txt: -msse2 -mfpmath=sse, since registers of the x87 hold more bits than memory).
# -DCMAKE_SYSROOT=FOLDER names the folder with its libraries (scripts/sysroot i386 FOLDER).
set(CMAKE_SYSTEM_PROCESSOR i386)
set(LIEGRAD_COMPILER i686-linux-gnu-gcc)
if(CMAKE_HOST_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64") # whose kernel runs these programs: no qemu
  set(LIEGRAD_LOADER ld-linux.so.2)
endif()
include(${CMAKE_CURRENT_LIST_DIR}/linux-gnu.cmake)
