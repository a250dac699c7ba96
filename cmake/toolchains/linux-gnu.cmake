# What the toolchains for Linux have in common: gcc for the other machine, libraries of its own folder alone, and qemu for what
# is to be run here (or the loader of that folder, where LIEGRAD_LOADER names one).
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_LIBRARY_ARCHITECTURE ${CMAKE_SYSTEM_PROCESSOR}-linux-gnu)
if(NOT LIEGRAD_COMPILER)
  set(LIEGRAD_COMPILER ${CMAKE_LIBRARY_ARCHITECTURE}-gcc)
endif()
set(CMAKE_C_COMPILER ${LIEGRAD_COMPILER})
if(CMAKE_SYSROOT) # before the C library that Debian's cross compilers may have of their own, which may be older
  set(lib ${CMAKE_SYSROOT}/usr/lib/${CMAKE_LIBRARY_ARCHITECTURE})
  set(include ${CMAKE_SYSROOT}/usr/include)
  set(CMAKE_C_FLAGS_INIT "-B${lib} -isystem ${include}/${CMAKE_LIBRARY_ARCHITECTURE} -isystem ${include}")
endif()
find_program(LIEGRAD_QEMU qemu-${CMAKE_SYSTEM_PROCESSOR})
mark_as_advanced(LIEGRAD_QEMU)
if(LIEGRAD_LOADER AND CMAKE_SYSROOT)
  set(CMAKE_CROSSCOMPILING_EMULATOR ${lib}/${LIEGRAD_LOADER} --library-path ${lib})
elseif(LIEGRAD_QEMU) # which has no filters of system calls
  set(CMAKE_CROSSCOMPILING_EMULATOR ${LIEGRAD_QEMU} ${LIEGRAD_QEMU_OPTIONS} -E LIEGRAD_UNCONFINED=1 -L "${CMAKE_SYSROOT}")
endif()
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
set(ENV{PKG_CONFIG_SYSROOT_DIR} "${CMAKE_SYSROOT}")
set(ENV{PKG_CONFIG_LIBDIR}
  "${CMAKE_SYSROOT}/usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}/pkgconfig:${CMAKE_SYSROOT}/usr/share/pkgconfig")
