# Packages by CPack, from the build folder: `cpack -G DEB` makes one .deb for each component of an installation, `cpack -G TGZ`
# an archive of all, `cpack --config CPackSourceConfig.cmake` the sources. scripts/package makes them all; docs/operating.md.
set(CPACK_PACKAGE_NAME ${PROJECT_NAME})
set(CPACK_PACKAGE_VENDOR "the liegrad authors")
# Whoever gives packages to others gives an address: -DCPACK_PACKAGE_CONTACT="Name <address>".
set(CPACK_PACKAGE_CONTACT "the liegrad authors <maintainers@liegrad.invalid>" CACHE STRING "Maintainer of packages")
set(CPACK_RESOURCE_FILE_LICENSE ${PROJECT_SOURCE_DIR}/LICENSE)
set(CPACK_PACKAGE_CHECKSUM SHA256)
set(CPACK_VERBATIM_VARIABLES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ
  WORLD_EXECUTE)
set(CPACK_GENERATOR TGZ)
set(CPACK_SOURCE_GENERATOR TGZ)
set(CPACK_SOURCE_PACKAGE_FILE_NAME ${PROJECT_NAME}-${PROJECT_VERSION})
# The files that the working tree may hold beside the sources: .gitignore.
string(REGEX REPLACE "([][+.*()^?])" "\\\\\\1" here ${PROJECT_SOURCE_DIR})
set(CPACK_SOURCE_IGNORE_FILES "^${here}/[.]git/" "^${here}/[.]cache/" "^${here}/build[^/]*/" "^${here}/examples/.*/build[^/]*/"
  "^${here}/(liegrad-demo|liegrad-reproduce|liegrad-packages|liegrad-site|pendulum-control|exported|examples/bare_c/exported)/"
  "^${here}/compile_commands[.]json$" "[.]o$" "[.]pyc$" "/__pycache__/" "~$"
  "/_CPack_Packages/" "[.](deb|tar[.]gz)([.]sha256)?$")

set(CPACK_LIEGRAD_CONTAINS_HDF5 "${LIEGRAD_HDF5_ARCHIVE_LINKS}") # for DebianFiles.cmake
set(CPACK_COMPONENTS_ALL runtime development tools documentation)
if(TARGET liegrad_mpi)
  list(APPEND CPACK_COMPONENTS_ALL mpi)
endif()
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 0upstream1) # sorts before a package of Debian
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)
set(CPACK_DEBIAN_PACKAGE_SOURCE ${PROJECT_NAME})
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${LIEGRAD_LIBRARY_FOLDER})
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS_POLICY "=")
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/cmake/DebianFiles.cmake)
set(same "liegrad (= ${PROJECT_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE})")

file(WRITE ${PROJECT_BINARY_DIR}/packages/triggers "activate-noawait ldconfig\n")
set(CPACK_DEBIAN_RUNTIME_PACKAGE_CONTROL_EXTRA ${PROJECT_BINARY_DIR}/packages/triggers)
set(CPACK_DEBIAN_MPI_PACKAGE_CONTROL_EXTRA ${PROJECT_BINARY_DIR}/packages/triggers)

# liegrad_package(component name summary text [field value]...): the description, its first line and what this package has,
# and more fields of the control file.
macro(liegrad_package component name summary text)
  string(TOUPPER ${component} upper)
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${name})
  set(CPACK_DEBIAN_${upper}_DESCRIPTION "liegrad, learning in mechanics and control: ${summary}
liegrad learns models of machines from measured trajectories, with networks
inside Lie group integrators, and evaluates them in control code.

${text}")
  set(fields ${ARGN})
  while(fields)
    list(POP_FRONT fields field value)
    set(CPACK_DEBIAN_${upper}_PACKAGE_${field} "${value}")
  endwhile()
endmacro()
# dpkg-shlibdeps does not see libsvm, which is loaded when it is needed.
set(svm)
if(LIEGRAD_CLASSIFY)
  execute_process(COMMAND dpkg-query -S "*/${LIEGRAD_SVM_NAME}" OUTPUT_VARIABLE owner ERROR_QUIET)
  string(REGEX REPLACE "[:,\n].*" "" owner "${owner}")
  if(owner)
    set(svm DEPENDS ${owner})
  endif()
endif()
liegrad_package(runtime liegrad "programs"
"This package has the shared libraries and the programs: lg-hamiltonian,
lg-identify, lg-simulate and others."
  RECOMMENDS gnuplot-nox ${svm})
liegrad_package(development liegrad-dev "development files"
"This package has the headers, which are the manual, archives for static
linking, what CMake and pkg-config read, and examples."
  SECTION libdevel DEPENDS "${same}" SUGGESTS "liegrad-doc, liegrad-mpi"
  RECOMMENDS "libopenblas-dev, libhdf5-dev, libyaml-dev, libseccomp-dev, pkg-config")
liegrad_package(tools liegrad-tools "checks and measurements"
"This package has lg-gradcheck, which checks every derivative of the library,
and lg-bench, which measures its speed."
  DEPENDS "${same}")
liegrad_package(mpi liegrad-mpi "training over MPI"
"This package lets the programs train by processes of one machine or of a
cluster, started by mpirun."
  DEPENDS "${same}" RECOMMENDS openmpi-bin)
liegrad_package(documentation liegrad-doc "pages"
"This package has the pages on conventions, files and models, the reports with
their plots, and all of them and the headers as a site for a browser:
/usr/share/doc/liegrad/html/index.html."
  SECTION doc ARCHITECTURE all)
include(CPack)
