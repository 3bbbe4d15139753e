# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0

# For ROS 2 as PyPI wheels, passed as CMAKE_PROJECT_INCLUDE by setup/bootstrap.
#
# The wheels' exported targets name the Python headers of the container that built them, below /opt/python. CMake refuses
# an imported target whose include folder does not exist, and the folders are not needed: what compiles against Python
# finds the headers of the Python at hand by itself. Dropping them here leaves the installed wheels as they came.

function(checkweigher_drop_container_includes)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(folders ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(folders MATCHES "/opt/python/")
      list(FILTER folders EXCLUDE REGEX "^/opt/python/")
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${folders}")
    endif()
  endforeach()
endfunction()

# One compiler run for many generated files: most of their time is spent on the same headers.
function(checkweigher_join_sources)
  get_property(targets DIRECTORY PROPERTY BUILDSYSTEM_TARGETS)
  foreach(target IN LISTS targets)
    if(target MATCHES "__rosidl_typesupport_")
      set_target_properties(${target} PROPERTIES UNITY_BUILD ON)
    endif()
  endforeach()
endfunction()

# At the end of the project, when every find_package() has made its targets. Once: project() of a subfolder includes this
# file, too.
if(CMAKE_CURRENT_SOURCE_DIR STREQUAL CMAKE_SOURCE_DIR)
  cmake_language(DEFER CALL checkweigher_drop_container_includes)
  cmake_language(DEFER CALL checkweigher_join_sources)
endif()
