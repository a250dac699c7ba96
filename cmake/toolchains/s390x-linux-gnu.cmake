# Linux on IBM Z, whose bytes are in big-endian order. -DCMAKE_SYSROOT=FOLDER names the folder with its libraries
# (scripts/sysroot s390x FOLDER).
set(CMAKE_SYSTEM_PROCESSOR s390x)
include(${CMAKE_CURRENT_LIST_DIR}/linux-gnu.cmake)
