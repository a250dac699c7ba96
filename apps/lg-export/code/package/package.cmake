# The model %NAME% as a library. Written by lg-export.
cmake_minimum_required(VERSION 3.10)
project(%NAME% VERSION 1.0.0 LANGUAGES C)
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()

add_library(%NAME% NAME_.c NAME_weights.c)
add_library(%NAME%::%NAME% ALIAS %NAME%)
set_target_properties(%NAME% PROPERTIES C_STANDARD 99 POSITION_INDEPENDENT_CODE ON PUBLIC_HEADER NAME_.h)
target_include_directories(%NAME% PUBLIC $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}>
  $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
target_link_libraries(%NAME% PUBLIC -lm)

set(config ${CMAKE_INSTALL_LIBDIR}/cmake/%NAME%)
install(TARGETS %NAME% EXPORT %NAME%Config PUBLIC_HEADER DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(EXPORT %NAME%Config NAMESPACE %NAME%:: DESTINATION ${config})
write_basic_package_version_file(%NAME%ConfigVersion.cmake COMPATIBILITY SameMajorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/%NAME%ConfigVersion.cmake DESTINATION ${config})
install(FILES package.xml DESTINATION ${CMAKE_INSTALL_DATADIR}/%NAME%)

enable_testing()
add_executable(NAME_test NAME_test.c)
target_link_libraries(NAME_test %NAME%)
add_test(NAME NAME_test COMMAND NAME_test)
