# `cmake --install`, and the Debian package: cpack -G DEB.
include(GNUInstallDirs)
set(share ${CMAKE_INSTALL_DATADIR}/selenograph)
set(package ${CMAKE_CURRENT_LIST_DIR})
install(TARGETS selenograph RUNTIME)
install(FILES api/clients/cpp/selenograph_client.hpp DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
# The C++ client for find_package(selenograph-client).
include(CMakePackageConfigHelpers)
set(client ${CMAKE_INSTALL_DATADIR}/cmake/selenograph-client)
install(TARGETS selenograph_client EXPORT selenograph-client INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(EXPORT selenograph-client NAMESPACE selenograph:: DESTINATION ${client} FILE selenograph-client-targets.cmake)
write_basic_package_version_file(selenograph-client-config-version.cmake COMPATIBILITY SameMinorVersion ARCH_INDEPENDENT)
install(FILES api/clients/cpp/selenograph-client-config.cmake
  ${CMAKE_CURRENT_BINARY_DIR}/selenograph-client-config-version.cmake DESTINATION ${client})
# Debian's Python looks there in /usr; elsewhere PYTHONPATH has to name it.
install(FILES api/clients/python/selenograph.py DESTINATION lib/python3/dist-packages)
install(FILES ${package}/selenograph.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
install(FILES ${package}/completion.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME selenograph)
install(DIRECTORY deploy/assets deploy/operation/haproxy deploy/operation/grafana deploy/operation/prometheus
  DESTINATION ${share} USE_SOURCE_PERMISSIONS)
file(GLOB requests deploy/examples/*-request.json)
install(FILES ${requests} DESTINATION ${share}/requests)
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} RENAME copyright)
install(FILES README.md CHANGELOG.md api/requests.md api/clients/conventions.md DESTINATION ${CMAKE_INSTALL_DOCDIR})
file(GLOB operation_pages deploy/operation/*.md)
install(FILES ${operation_pages} DESTINATION ${CMAKE_INSTALL_DOCDIR}/operation)
install(FILES ${package}/selenograph.service DESTINATION lib/systemd/system)
install(FILES ${package}/selenograph.sysusers DESTINATION lib/sysusers.d RENAME selenograph.conf)
# /etc beside /usr, else below the prefix; one that is there already is somebody's.
install(CODE "set(example \"${package}/selenograph.toml\")")
install(CODE [[
  get_filename_component(etc "${CMAKE_INSTALL_PREFIX}/etc" ABSOLUTE)
  if(CMAKE_INSTALL_PREFIX MATCHES "/usr/?$")
    get_filename_component(etc "${CMAKE_INSTALL_PREFIX}/../etc" ABSOLUTE)
  endif()
  if(NOT EXISTS "$ENV{DESTDIR}${etc}/selenograph/selenograph.toml")
    file(INSTALL "${example}" DESTINATION "${etc}/selenograph")
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
  "Frames that a camera near the Moon sees, with true shadows, and the truth\nbehind each pixel: over HTTP and as a command.")
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
# For the service's user.
set(CPACK_DEBIAN_PACKAGE_DEPENDS "systemd | systemd-standalone-sysusers")
set(CPACK_DEBIAN_PACKAGE_SUGGESTS
  "haproxy, python3, python3-numpy, libcpp-httplib-dev, nlohmann-json3-dev, pkg-config, bash-completion")
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA ${package}/conffiles ${package}/postinst ${package}/prerm ${package}/postrm)
include(CPack)
