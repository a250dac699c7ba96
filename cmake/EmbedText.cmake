# Files as text in one generated C file: a table of {name, text}, a row for each file below some folders, and a last row of NULL.
# C files and gnuplot scripts (.gp) are named without their ending, others (.sh, .yaml, .cin, .gmake, .cmake) with it. As a script: cmake -DFOLDERS=... -DOUT=... -DHEADER=... -DTABLE=... -P EmbedText.cmake. Included: embed_text.
#
# embed_text(out header table folder...): the generated file's path into `out`; made again when a file below a folder
# changes, comes or goes. `header` declares `table`, an array such as "const lg_named_text export_fragments[]".
if(CMAKE_SCRIPT_MODE_FILE)
  string(REPLACE "|" ";" FOLDERS "${FOLDERS}")
  list(TRANSFORM FOLDERS APPEND "/*.[cgsy]*")
  file(GLOB_RECURSE files ${FOLDERS})
  list(SORT files)
  set(rows "")
  foreach(file IN LISTS files)
    get_filename_component(name ${file} NAME)
    string(REGEX REPLACE "\\.(c|gp)$" "" name ${name})
    file(READ ${file} text)
    string(REPLACE "\\" "\\\\" text "${text}")
    string(REPLACE "\"" "\\\"" text "${text}")
    string(REPLACE "?" "\\?" text "${text}")
    string(REPLACE "\n" "\\n\"\n     \"" text "${text}")
    string(APPEND rows "    {\"${name}\",\n     \"${text}\"},\n")
  endforeach()
  file(WRITE ${OUT} "#include \"${HEADER}\"\n\n${TABLE} = {\n${rows}    {NULL, NULL}};\n")
  return()
endif()

set(EMBED_TEXT_SCRIPT ${CMAKE_CURRENT_LIST_FILE})
function(embed_text out header table)
  set(patterns ${ARGN})
  list(TRANSFORM patterns APPEND "/*.[cgsy]*")
  file(GLOB_RECURSE files CONFIGURE_DEPENDS ${patterns})
  list(JOIN ARGN "|" folders)
  set(generated ${CMAKE_CURRENT_BINARY_DIR}/${out}.c)
  # The list of names is a dependence too: without it a file that goes would stay in the table.
  list(JOIN files "\n" names)
  file(GENERATE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/${out}.txt CONTENT "${names}\n")
  add_custom_command(OUTPUT ${generated}
    COMMAND ${CMAKE_COMMAND} "-DFOLDERS=${folders}" -DOUT=${generated} -DHEADER=${header}
      "-DTABLE=${table}" -P ${EMBED_TEXT_SCRIPT}
    DEPENDS ${files} ${EMBED_TEXT_SCRIPT} ${CMAKE_CURRENT_BINARY_DIR}/${out}.txt
    COMMENT "Embedding ${folders}" VERBATIM)
  set(${out} ${generated} PARENT_SCOPE)
endfunction()
