# Unpacks crates as `cargo package` writes them: manifests without workspace inheritance, symlinked
# message files as files. Run by `cmake -P` with CARGO, WORKSPACE, CRATES and ROOT.
cmake_minimum_required(VERSION 3.20)

set(_packages "")
foreach(_crate ${CRATES})
  list(APPEND _packages -p ${_crate})
endforeach()

# Not the lock file: a library's user has their own, and resolving one for a crate that is in no
# registry needs a newer cargo than the oldest we support. Not --locked either, for the same reason.
execute_process(
  COMMAND "${CARGO}" package ${_packages} --no-verify --allow-dirty --exclude-lockfile --quiet
    --target-dir "${ROOT}/target"
  WORKING_DIRECTORY "${WORKSPACE}"
  OUTPUT_VARIABLE _output ERROR_VARIABLE _output RESULT_VARIABLE _result)
if(NOT _result EQUAL 0)
  message(FATAL_ERROR "cargo package failed:\n${_output}")
endif()

foreach(_crate ${CRATES})
  file(GLOB _archive "${ROOT}/target/package/${_crate}-[0-9]*.crate")
  list(LENGTH _archive _count)
  if(NOT _count EQUAL 1)
    message(FATAL_ERROR "expected one archive of ${_crate} in ${ROOT}/target/package, found: ${_archive}")
  endif()
  get_filename_component(_name "${_archive}" NAME)
  string(REGEX REPLACE "\\.crate$" "" _name "${_name}")
  file(REMOVE_RECURSE "${ROOT}/unpacked" "${ROOT}/${_crate}")
  file(ARCHIVE_EXTRACT INPUT "${_archive}" DESTINATION "${ROOT}/unpacked")
  file(RENAME "${ROOT}/unpacked/${_name}" "${ROOT}/${_crate}")
  # Of use to a registry only, and different with every commit; and what would look like a second
  # copy of our packages to colcon.
  file(GLOB_RECURSE _needless "${ROOT}/${_crate}/package.xml" "${ROOT}/${_crate}/CMakeLists.txt")
  file(REMOVE "${ROOT}/${_crate}/.cargo_vcs_info.json" "${ROOT}/${_crate}/Cargo.toml.orig"
    "${ROOT}/${_crate}/COLCON_IGNORE" ${_needless})

  # Normalising drops the paths between our crates. Installed they lie side by side, so a foreign
  # crate needs one path only and no registry ever has to know the others. Those that its tests need have the same
  # path, because cargo refuses a crate with two.
  file(READ "${ROOT}/${_crate}/Cargo.toml" _manifest)
  foreach(_other ${CRATES})
    string(REPLACE "dependencies.${_other}]\n" "dependencies.${_other}]\npath = \"../../${_other}/rust\"\n"
      _manifest "${_manifest}")
  endforeach()
  file(WRITE "${ROOT}/${_crate}/Cargo.toml" "${_manifest}")
endforeach()
file(REMOVE_RECURSE "${ROOT}/unpacked" "${ROOT}/target")
