# What Debian wants in its packages and nobody else: read by CPack when the components lie in CPACK_TEMPORARY_DIRECTORY, each in a
# folder of its name. Programs and libraries lose search paths and symbols, pages are compressed, copyright and changelog
# lie in the folder of each package.
if(NOT CPACK_GENERATOR STREQUAL "DEB")
  return()
endif()
find_program(STRIP strip REQUIRED)
find_program(GZIP gzip REQUIRED)

function(compress)
  execute_process(COMMAND ${GZIP} -9nf ${ARGN} COMMAND_ERROR_IS_FATAL ANY)
endfunction()

string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC) # that of SOURCE_DATE_EPOCH if there is one
foreach(component IN LISTS CPACK_COMPONENTS_ALL)
  string(TOUPPER ${component} upper)
  set(usr ${CPACK_TEMPORARY_DIRECTORY}/${component}/usr)
  set(doc ${usr}/share/doc/${CPACK_DEBIAN_${upper}_PACKAGE_NAME})
  file(MAKE_DIRECTORY ${doc})

  file(GLOB_RECURSE binaries ${usr}/bin/* ${usr}/lib/*.so.*)
  foreach(file IN LISTS binaries)
    if(NOT IS_SYMLINK ${file})
      file(RPATH_REMOVE FILE ${file})
      execute_process(COMMAND ${STRIP} --strip-unneeded --remove-section=.comment --remove-section=.note ${file}
        COMMAND_ERROR_IS_FATAL ANY)
    endif()
  endforeach()
  file(GLOB_RECURSE archives ${usr}/lib/*.a)
  foreach(file IN LISTS archives)
    execute_process(COMMAND ${STRIP} --strip-debug --enable-deterministic-archives --remove-section=.comment --remove-section=.note
      ${file} COMMAND_ERROR_IS_FATAL ANY)
  endforeach()

  file(GLOB pages ${usr}/share/man/man1/*.1 ${usr}/share/man/man7/*.7)
  if(pages)
    compress(${pages})
  endif()
  file(REMOVE ${usr}/share/doc/liegrad/LICENSE) # its words are in `copyright`
  if(EXISTS ${usr}/share/doc/liegrad/README.md)
    file(READ ${usr}/share/doc/liegrad/README.md text)
    string(REPLACE "](LICENSE)" "](../${CPACK_DEBIAN_${upper}_PACKAGE_NAME}/copyright)" text "${text}")
    file(WRITE ${usr}/share/doc/liegrad/README.md "${text}")
  endif()
  set(site ${usr}/share/doc/liegrad/html)
  set(others "")
  if(EXISTS ${site}/index.html)
    file(REMOVE ${site}/LICENSE)
    file(REMOVE_RECURSE ${site}/docs/reports) # the package has them once
    file(CREATE_LINK ../../docs/reports ${site}/docs/reports SYMBOLIC)
    set(others "\nThe folder html was made with Doxygen and doxygen-awesome-css. Their scripts and styles in it (*.js, doxygen*.css) have\n\
the licence MIT, too: copyright Dimitri van Heesch, the authors of jQuery, and jothepro; the files say more.\n")
    file(READ ${site}/index.html text)
    string(REPLACE "\"./LICENSE\"" "\"../../${CPACK_DEBIAN_${upper}_PACKAGE_NAME}/copyright\"" text "${text}")
    file(WRITE ${site}/index.html "${text}")
    file(WRITE ${usr}/share/doc-base/${CPACK_DEBIAN_${upper}_PACKAGE_NAME}.liegrad "\
Document: liegrad\nTitle: liegrad\nAuthor: ${CPACK_PACKAGE_VENDOR}\n\
Abstract: Pages and headers of liegrad, a machine-learning framework in C\n for mechanics and control.\n\
Section: Science/Mathematics\n\nFormat: HTML\nIndex: /usr/share/doc/liegrad/html/index.html\n\
Files: /usr/share/doc/liegrad/html/*.html\n")
  endif()
  file(GLOB programs ${usr}/bin/lg-*)
  if(programs AND CPACK_LIEGRAD_CONTAINS_HDF5 AND EXISTS /usr/share/doc/libhdf5-dev/copyright)
    file(READ /usr/share/doc/libhdf5-dev/copyright hdf5)
    string(APPEND others "\nThe programs contain HDF5, whose licence follows.\n\n${hdf5}")
  endif()
  if(EXISTS ${usr}/share/doc/liegrad/CHANGELOG.md)
    file(RENAME ${usr}/share/doc/liegrad/CHANGELOG.md ${doc}/changelog)
    compress(${doc}/changelog)
  endif()
  file(READ ${CPACK_RESOURCE_FILE_LICENSE} licence)
  file(WRITE ${doc}/copyright "${licence}${others}")
  file(WRITE ${doc}/changelog.Debian "${CPACK_PACKAGE_NAME} (${CPACK_PACKAGE_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE}) unstable; \
urgency=medium\n\n  * Version ${CPACK_PACKAGE_VERSION}.\n\n -- ${CPACK_PACKAGE_CONTACT}  ${date}\n")
  compress(${doc}/changelog.Debian)
  file(CHMOD ${doc}/copyright ${doc}/changelog.Debian.gz PERMISSIONS OWNER_READ OWNER_WRITE GROUP_READ WORLD_READ)
endforeach()

file(WRITE ${CPACK_TEMPORARY_DIRECTORY}/runtime/usr/share/lintian/overrides/liegrad "\
# Programs and libraries are one release; the name of the package is that of the programs, and who links the\n\
# libraries depends on this version.\n\
liegrad: package-name-doesnt-match-sonames *\n\
# CPack writes these two scripts itself; the trigger is there too.\n\
liegrad: maintscript-calls-ldconfig *\n")
list(FIND CPACK_COMPONENTS_ALL mpi mpi)
if(NOT mpi EQUAL -1)
  file(WRITE ${CPACK_TEMPORARY_DIRECTORY}/mpi/usr/share/lintian/overrides/liegrad-mpi "\
# A library that the programs load; its name is theirs.\n\
liegrad-mpi: package-name-doesnt-match-sonames *\n\
liegrad-mpi: maintscript-calls-ldconfig *\n")
endif()
