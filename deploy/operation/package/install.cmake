# `cmake --install`, and the Debian package: cpack -G DEB.
include(GNUInstallDirs)
set(share ${CMAKE_INSTALL_DATADIR}/selenograph)
set(package ${CMAKE_CURRENT_LIST_DIR})
# The executable looks for the library of images relative to itself: any prefix will do.
install(TARGETS selenograph RUNTIME)
install(TARGETS selenograph_images LIBRARY DESTINATION lib/selenograph)
set_target_properties(selenograph PROPERTIES INSTALL_RPATH "$ORIGIN/../lib/selenograph")
install(FILES api/clients/cpp/selenograph_client.hpp DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
# The C++ client for find_package(selenograph-client).
include(CMakePackageConfigHelpers)
set(client ${CMAKE_INSTALL_DATADIR}/cmake/selenograph-client)
install(TARGETS selenograph_client EXPORT selenograph-client INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(EXPORT selenograph-client NAMESPACE selenograph:: DESTINATION ${client} FILE selenograph-client-targets.cmake)
write_basic_package_version_file(selenograph-client-config-version.cmake COMPATIBILITY SameMajorVersion
  ARCH_INDEPENDENT)
install(FILES api/clients/cpp/selenograph-client-config.cmake
  ${CMAKE_CURRENT_BINARY_DIR}/selenograph-client-config-version.cmake DESTINATION ${client})
# Debian's Python looks there in /usr; elsewhere PYTHONPATH has to name it.
install(DIRECTORY api/clients/python/selenograph DESTINATION lib/python3/dist-packages
  FILES_MATCHING PATTERN *.py PATTERN __pycache__ EXCLUDE)
install(FILES ${package}/completion.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions
  RENAME selenograph)
install(DIRECTORY deploy/assets deploy/operation/haproxy deploy/operation/grafana deploy/operation/prometheus
  DESTINATION ${share} USE_SOURCE_PERMISSIONS)
file(GLOB requests deploy/examples/*-request.json)
install(FILES ${requests} DESTINATION ${share}/requests)
install(FILES ${package}/copyright DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(CODE "execute_process(COMMAND ${package}/spdx $<TARGET_FILE:selenograph>
  $<TARGET_FILE:selenograph_images> ${PROJECT_VERSION} OUTPUT_FILE ${CMAKE_CURRENT_BINARY_DIR}/selenograph.spdx.json
  COMMAND_ERROR_IS_FATAL ANY)")
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/selenograph.spdx.json DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(FILES README.md CHANGELOG.md api/requests.md api/clients/conventions.md DESTINATION ${CMAKE_INSTALL_DOCDIR})
file(GLOB operation_pages deploy/operation/*.md)
install(FILES ${operation_pages} DESTINATION ${CMAKE_INSTALL_DOCDIR}/operation)
install(FILES ${package}/selenograph.sysusers DESTINATION lib/sysusers.d RENAME selenograph.conf)
# These name where they and others lie, and are written for /usr, which any prefix that ends so is going to be. /etc is
# beside it, else below the prefix; a configuration that is there already is somebody's.
install(CODE "set(package \"${package}\")
set(written \"${CMAKE_CURRENT_BINARY_DIR}/written\")
set(mandir \"${CMAKE_INSTALL_MANDIR}\")")
install(CODE [[
  get_filename_component(prefix "${CMAKE_INSTALL_PREFIX}" ABSOLUTE)
  set(usr "${prefix}")
  set(etc "${prefix}/etc")
  set(etc_there "${etc}")
  if(prefix MATCHES "/usr$")
    set(usr /usr)
    set(etc /etc)
    get_filename_component(etc_there "${prefix}/../etc" ABSOLUTE)
  endif()
  foreach(name selenograph.toml selenograph.service selenograph.1)
    file(READ "${package}/${name}" text)
    string(REPLACE "/usr/" "${usr}/" text "${text}")
    string(REPLACE "/etc/selenograph/" "${etc}/selenograph/" text "${text}")
    file(WRITE "${written}/${name}" "${text}")
  endforeach()
  file(INSTALL "${written}/selenograph.service" DESTINATION "${prefix}/lib/systemd/system")
  file(INSTALL "${written}/selenograph.1" DESTINATION "${prefix}/${mandir}/man1")
  if(NOT EXISTS "$ENV{DESTDIR}${etc_there}/selenograph/selenograph.toml")
    file(INSTALL "${written}/selenograph.toml" DESTINATION "${etc_there}/selenograph")
  endif()
]])

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME selenograph)
set(CPACK_PACKAGE_VENDOR selenograph)
set(CPACK_PACKAGE_CONTACT "the maintainers of selenograph <selenograph@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "Images of the Moon for navigation")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION
  "Frames of a camera near the Moon, with ground truth for every pixel:\nover HTTP and as a command.")
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
# For the service's user.
set(CPACK_DEBIAN_PACKAGE_DEPENDS "systemd | systemd-standalone-sysusers")
set(CPACK_DEBIAN_PACKAGE_SUGGESTS
  "haproxy, python3, python3-numpy, libcpp-httplib-dev, nlohmann-json3-dev, pkg-config, bash-completion")
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA ${package}/conffiles ${package}/postinst ${package}/prerm ${package}/postrm)
include(CPack)
