# Whether programs speak through the middleware of the ROS 2 that is sourced (docs/adr/003-two-adapters.md): by
# default where there is one.
#
#   WRAPYFI_RMW              the choice
#   WRAPYFI_FEATURES         what Cargo is told
#   WRAPYFI_RMW_PREFIX_PATH  where its headers and libraries are; the same for each package, so that Cargo finds
#                            the work of the first one done

# rmw_implementation loads the middleware; where it is missing, as in wheels of PyPI, one is linked (crates/wrapyfi_rmw/build.rs).
set(_one_of lib/librmw_implementation.so lib/librmw_fastrtps_cpp.so lib/librmw_zenoh_cpp.so lib/librmw_cyclonedds_cpp.so)
list(JOIN _one_of " or " _any)
set(_files include/rmw/rmw/rmw.h lib/libfastcdr.so)
string(REPLACE ":" ";" _sourced "$ENV{AMENT_PREFIX_PATH}")
set(_missing ${_files} "${_any}")
set(_prefixes "")
foreach(_prefix IN LISTS _sourced)
  # In a workspace that has ROS 2 in it, only this tells its packages from ours, which colcon adds one by one.
  set(_is_ours OFF)
  foreach(_package wrapyfi_msgs wrapyfi_core wrapyfi_bridge wrapyfi_py wrapyfi)
    if(EXISTS "${_prefix}/share/${_package}/package.xml")
      set(_is_ours ON)
    endif()
  endforeach()
  foreach(_file IN LISTS _files _one_of)
    if(EXISTS "${_prefix}/${_file}")
      if(_file IN_LIST _one_of)
        set(_file "${_any}")
      endif()
      list(REMOVE_ITEM _missing "${_file}")
      set(_is_ours OFF)
    endif()
  endforeach()
  if(NOT _is_ours)
    list(APPEND _prefixes "${_prefix}")
  endif()
endforeach()

if(_missing)
  set(_found OFF)
else()
  set(_found ON)
endif()
option(WRAPYFI_RMW "ROS 2 through its own rmw, beside the CycloneDDS inside" ${_found})
set(WRAPYFI_FEATURES "")
set(WRAPYFI_RMW_PREFIX_PATH "")
list(JOIN _missing ", no " _missing)
if(WRAPYFI_RMW AND _missing)
  message(FATAL_ERROR "WRAPYFI_RMW is ON, and AMENT_PREFIX_PATH=\"$ENV{AMENT_PREFIX_PATH}\" has no ${_missing}. "
    "Source a ROS 2 that has ros-base (`. /opt/ros/<distribution>/setup.bash`), or pass -DWRAPYFI_RMW=OFF.")
elseif(WRAPYFI_RMW)
  list(JOIN _prefixes ":" WRAPYFI_RMW_PREFIX_PATH)
  set(WRAPYFI_FEATURES --features wrapyfi_bridge/rmw,wrapyfi_bridge/bags,wrapyfi_bridge/formats)
  message(STATUS "ROS 2: through the rmw of ${WRAPYFI_RMW_PREFIX_PATH}; -DWRAPYFI_RMW=OFF for CycloneDDS inside alone")
elseif(_found)
  message(STATUS "ROS 2: CycloneDDS inside alone; an rmw is sourced: -DWRAPYFI_RMW=ON to speak through it")
elseif(_missing MATCHES "rmw.h")
  message(STATUS "ROS 2: CycloneDDS inside alone, because no rmw is sourced")
else()
  message(STATUS "ROS 2: CycloneDDS inside alone, because the rmw that is sourced has no ${_missing}")
endif()
foreach(_name _one_of _any _files _sourced _missing _prefixes _prefix _is_ours _package _file _found)
  unset(${_name})
endforeach()
