# Cargo inside ament_cmake packages.
#
# One and the same command builds what is installed, whichever package asks, into one target folder
# beside the packages' build folders: the second package finds its work done, and CycloneDDS is compiled
# once. With BUILD_TESTING it builds the whole workspace and the tests.
#
#   wrapyfi_cargo_build()                    builds as part of `all`
#   wrapyfi_cargo_install_crates(NAME...)    normalised sources to share/NAME/rust, and their index marker
#   wrapyfi_cargo_test(NAME [TIMEOUT s] [DOC_TESTS])  one CTest entry that runs the tests of crate NAME,
#                                            and with DOC_TESTS the doc tests of all crates

get_filename_component(WRAPYFI_WORKSPACE "${CMAKE_CURRENT_LIST_DIR}/.." ABSOLUTE)
set(WRAPYFI_RUST_MINIMUM 1.89)
# Libraries whose sources are installed.
set(WRAPYFI_LIBRARIES wrapyfi_retry wrapyfi_interfaces wrapyfi_data wrapyfi_plugins wrapyfi_endpoint wrapyfi_engine wrapyfi_node wrapyfi_macros wrapyfi_yarp wrapyfi_rmw
  wrapyfi_zeromq wrapyfi_ros1 wrapyfi_ros2 wrapyfi_yarp_endpoint wrapyfi_core)

include("${CMAKE_CURRENT_LIST_DIR}/wrapyfi_rmw.cmake")

# The environment is read once and kept: `colcon test` runs in another shell and must find the
# same folder.
if(DEFINED ENV{CARGO_TARGET_DIR} AND NOT "$ENV{CARGO_TARGET_DIR}" STREQUAL "")
  get_filename_component(_target "$ENV{CARGO_TARGET_DIR}" ABSOLUTE BASE_DIR "${WRAPYFI_WORKSPACE}")
else()
  get_filename_component(_target "${CMAKE_BINARY_DIR}/../wrapyfi_cargo" ABSOLUTE)
endif()
set(WRAPYFI_CARGO_TARGET_DIR "${_target}" CACHE PATH "Cargo's target folder, shared by the packages")
unset(_target)

# Optimised whatever CMAKE_BUILD_TYPE says, because colcon sets none and pictures would crawl. `dev` compiles
# in a third of the time, where the build is what is tested.
set(WRAPYFI_CARGO_PROFILE colcon CACHE STRING "Profile of Cargo: colcon, release or dev")
if(WRAPYFI_CARGO_PROFILE STREQUAL "dev")
  set(WRAPYFI_PROGRAMS_DIR "${WRAPYFI_CARGO_TARGET_DIR}/debug")
else()
  set(WRAPYFI_PROGRAMS_DIR "${WRAPYFI_CARGO_TARGET_DIR}/${WRAPYFI_CARGO_PROFILE}")
endif()

set(WRAPYFI_TESTED_CRATES "" CACHE STRING "Crates whose tests are built and run, wrapyfi_bridge among them; none for all")

# Rustup's before PATH: distributions put their old cargo where a shell without ~/.cargo/env finds it.
# It picks the tool chain when it runs, so asking in the workspace gives the version that will build it.
# Where that is too old or there is none, the one of Ubuntu 24.04's package cargo-1.89, which is all that ROS's build machines have.
find_program(CARGO_EXECUTABLE cargo HINTS "$ENV{CARGO_HOME}/bin" "$ENV{HOME}/.cargo/bin")
find_program(WRAPYFI_VERSIONED_CARGO cargo-${WRAPYFI_RUST_MINIMUM})
set(_remedy "Install it through rustup (https://rustup.rs) or run `rustup update stable`. "
  "On Ubuntu 24.04 `sudo apt install cargo-1.89 rustc-1.89` serves too. The plain cargo of Ubuntu 24.04 and Debian 12 is too old.")
string(CONCAT _remedy ${_remedy})
if(NOT CARGO_EXECUTABLE AND NOT WRAPYFI_VERSIONED_CARGO)
  message(FATAL_ERROR "${PROJECT_NAME} needs Rust ${WRAPYFI_RUST_MINIMUM} or newer; there is no cargo. ${_remedy}")
endif()
foreach(_cargo "${WRAPYFI_VERSIONED_CARGO}" "${CARGO_EXECUTABLE}")
  if(_cargo)
    set(_found "${_cargo}")
    execute_process(
      COMMAND "${_cargo}" --version
      WORKING_DIRECTORY "${WRAPYFI_WORKSPACE}"
      OUTPUT_VARIABLE _version ERROR_VARIABLE _error RESULT_VARIABLE _result
      OUTPUT_STRIP_TRAILING_WHITESPACE)
    string(REGEX MATCH "[0-9]+\\.[0-9]+(\\.[0-9]+)?" _number "${_version}")
    if(_result EQUAL 0 AND _number VERSION_GREATER_EQUAL WRAPYFI_RUST_MINIMUM)
      set(_usable "${_cargo}")
    endif()
  endif()
endforeach()
if(NOT _usable)
  message(FATAL_ERROR "${PROJECT_NAME} needs Rust ${WRAPYFI_RUST_MINIMUM} or newer; "
    "${_found} says: ${_version}${_error}. ${_remedy}")
endif()
set(CARGO_EXECUTABLE "${_usable}")

# JPEG goes through the system's libjpeg-turbo, which the crate turbojpeg finds by pkg-config.
find_program(WRAPYFI_PKG_CONFIG NAMES pkg-config pkgconf)
if(WRAPYFI_PKG_CONFIG)
  execute_process(COMMAND "${WRAPYFI_PKG_CONFIG}" --exists "libturbojpeg >= 2.0" RESULT_VARIABLE _no_turbojpeg)
endif()
if(NOT WRAPYFI_PKG_CONFIG OR _no_turbojpeg)
  message(FATAL_ERROR "${PROJECT_NAME} links libturbojpeg, and pkg-config does not find it. "
    "Run `rosdep install --from-paths ${WRAPYFI_WORKSPACE} --ignore-src`, or "
    "`sudo apt install libturbojpeg0-dev pkg-config`.")
endif()

# Zstandard of recordings: the system's, which has it compiled. Elsewhere the crate zstd-sys compiles its copy.
set(_wrapyfi_libraries "")
execute_process(COMMAND "${WRAPYFI_PKG_CONFIG}" --exists "libzstd >= 1.4.8" RESULT_VARIABLE _no_zstd)
if(NOT _no_zstd)
  set(_wrapyfi_libraries "ZSTD_SYS_USE_PKG_CONFIG=1")
endif()

# Tests have sockets of libzmq as peers: the system's on these two, elsewhere the copy that the crate zmq-sys compiles.
if(BUILD_TESTING AND CMAKE_HOST_SYSTEM_PROCESSOR MATCHES "^(x86_64|aarch64)$"
    AND NOT EXISTS "/usr/lib/${CMAKE_HOST_SYSTEM_PROCESSOR}-linux-gnu/libzmq.so")
  message(FATAL_ERROR "Tests of ${PROJECT_NAME} link libzmq, which is not here. Build without them (-DBUILD_TESTING=OFF), or "
    "run `rosdep install --from-paths ${WRAPYFI_WORKSPACE} --ignore-src`, or `sudo apt install libzmq3-dev`.")
endif()

foreach(_name _version _error _result _number _found _usable _remedy _no_turbojpeg _no_zstd)
  unset(${_name})
endforeach()

# The compiler that has its version in its name is not found by a cargo that has.
set(_wrapyfi_rustc "")
if(CARGO_EXECUTABLE MATCHES "/cargo-([0-9.]+)$")
  set(_wrapyfi_rustc "RUSTC=rustc-${CMAKE_MATCH_1}" "RUSTDOC=rustdoc-${CMAKE_MATCH_1}")
endif()

# Only the target folder differs from what a developer types, so nothing is built twice for a flag.
set(_wrapyfi_cargo
  "${CMAKE_COMMAND}" -E env ${_wrapyfi_rustc} "CARGO_TARGET_DIR=${WRAPYFI_CARGO_TARGET_DIR}"
  "WRAPYFI_RMW_PREFIX_PATH=${WRAPYFI_RMW_PREFIX_PATH}" ${_wrapyfi_libraries} "${CARGO_EXECUTABLE}")

function(wrapyfi_cargo_build)
  # Quiet: colcon reports whatever is on standard error, and Cargo tells its progress there. Warnings
  # and errors are printed all the same.
  set(_build ${_wrapyfi_cargo} build --quiet --profile ${WRAPYFI_CARGO_PROFILE} --locked)
  if(BUILD_TESTING)
    # The whole workspace with its tests at once, because Cargo unites the features of what it builds: what
    # is built in two commands has other features in each, and is compiled twice. Tests are compiled here and
    # not by `colcon test`, which has a time limit.
    set(_packages --workspace)
    if(WRAPYFI_TESTED_CRATES)
      list(TRANSFORM WRAPYFI_TESTED_CRATES PREPEND "--package=" OUTPUT_VARIABLE _packages)
    endif()
    set(_commands COMMAND ${_build} ${_packages} --all-targets ${WRAPYFI_FEATURES})
  else()
    # The program alone, which has every library in it: macros that are named too are compiled for the program as well.
    set(_packages --package=wrapyfi_bridge)
    # Services of Fast DDS nodes go through rmw where there is one: RustDDS is left out.
    if(WRAPYFI_RMW)
      list(APPEND _packages --no-default-features)
    endif()
    set(_commands COMMAND ${_build} ${_packages} ${WRAPYFI_FEATURES})
  endif()
  # Cargo knows what is out of date; CMake only ever asks it.
  add_custom_target(wrapyfi_cargo ALL
    # colcon would crawl the folder where it lies inside somebody's sources.
    COMMAND "${CMAKE_COMMAND}" -E make_directory "${WRAPYFI_CARGO_TARGET_DIR}"
    COMMAND "${CMAKE_COMMAND}" -E touch "${WRAPYFI_CARGO_TARGET_DIR}/COLCON_IGNORE"
    ${_commands}
    WORKING_DIRECTORY "${WRAPYFI_WORKSPACE}"
    COMMENT "cargo build --profile ${WRAPYFI_CARGO_PROFILE}: some minutes without a word"
    USES_TERMINAL
    VERBATIM)
endfunction()

function(wrapyfi_cargo_install_crates)
  set(_root "${CMAKE_CURRENT_BINARY_DIR}/crates")
  # One call for all: a crate may need another one that is in no registry.
  add_custom_target(wrapyfi_crates ALL
    COMMAND "${CMAKE_COMMAND}"
      "-DCARGO=${CARGO_EXECUTABLE}" "-DWORKSPACE=${WRAPYFI_WORKSPACE}" "-DCRATES=${ARGN}" "-DROOT=${_root}"
      -P "${WRAPYFI_WORKSPACE}/cmake/package_crates.cmake"
    COMMENT "cargo package: ${ARGN}"
    VERBATIM)
  foreach(_crate ${ARGN})
    install(DIRECTORY "${_root}/${_crate}/" DESTINATION "share/${_crate}/rust")
    # What ros2-rust's colcon extension looks for to offer the crate to other packages.
    ament_index_register_resource(rust_packages PACKAGE_NAME "${_crate}" CONTENT "")
  endforeach()
endfunction()

function(wrapyfi_cargo_test _crate)
  if(WRAPYFI_TESTED_CRATES AND NOT _crate IN_LIST WRAPYFI_TESTED_CRATES)
    return()
  endif()
  cmake_parse_arguments(_arg "DOC_TESTS" "TIMEOUT" "" ${ARGN})
  if(NOT _arg_TIMEOUT)
    set(_arg_TIMEOUT 600)
  endif()
  set(_doc_tests "")
  if(_arg_DOC_TESTS)
    set(_doc_tests --doc-tests)
  endif()
  # Commas, because ament_add_test takes a list apart.
  list(JOIN WRAPYFI_TESTED_CRATES "," _tested)
  get_executable_path(_python Python3::Interpreter BUILD)
  set(_result "${AMENT_TEST_RESULTS_DIR}/${PROJECT_NAME}/${_crate}.xunit.xml")
  ament_add_test(${_crate}
    COMMAND "${_python}" "${WRAPYFI_WORKSPACE}/cmake/cargo_test.py"
      --cargo "${CARGO_EXECUTABLE}" --target-dir "${WRAPYFI_CARGO_TARGET_DIR}"
      --profile "${WRAPYFI_CARGO_PROFILE}" --package "${_crate}" --result "${_result}" "--rmw=${WRAPYFI_RMW_PREFIX_PATH}"
      "--tested=${_tested}" ${_doc_tests}
    RESULT_FILE "${_result}"
    ENV ${_wrapyfi_rustc} ${_wrapyfi_libraries}
    WORKING_DIRECTORY "${WRAPYFI_WORKSPACE}"
    TIMEOUT ${_arg_TIMEOUT})
endfunction()
