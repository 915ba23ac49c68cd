# What catkin gives otherwise: the version, where to install, shared libraries, tests.
file(STRINGS ${PROJECT_SOURCE_DIR}/package.xml version_line REGEX "<version>")
string(REGEX REPLACE ".*<version>(.*)</version>.*" "\\1" ${PROJECT_NAME}_VERSION "${version_line}")
option(BUILD_SHARED_LIBS "Build shared libraries" ON)
include(GNUInstallDirs)
include(CTest)

set(lib_destination ${CMAKE_INSTALL_LIBDIR})
set(bin_destination ${CMAKE_INSTALL_BINDIR})
set(include_destination ${CMAKE_INSTALL_INCLUDEDIR})
set(share_destination ${CMAKE_INSTALL_DATADIR}/${PROJECT_NAME})
set(cmake_destination ${CMAKE_INSTALL_LIBDIR}/cmake/${PROJECT_NAME})
# Programs find the libraries that are installed with them.
set(CMAKE_INSTALL_RPATH "$ORIGIN/../${CMAKE_INSTALL_LIBDIR}")

include(CMakePackageConfigHelpers)
set(config ${CMAKE_CURRENT_BINARY_DIR}/${PROJECT_NAME}Config.cmake)
set(config_version ${CMAKE_CURRENT_BINARY_DIR}/${PROJECT_NAME}ConfigVersion.cmake)
configure_file(cmake/${PROJECT_NAME}-core.cmake.in ${config} @ONLY)
write_basic_package_version_file(${config_version}
  VERSION ${${PROJECT_NAME}_VERSION} COMPATIBILITY SameMajorVersion)
install(FILES ${config} ${config_version} DESTINATION ${cmake_destination})
