# Fails if BINARY has tests that FILTER, which leaves out those of all source files, does not leave out.
execute_process(COMMAND ${BINARY} --gtest_list_tests --gtest_filter=${FILTER} OUTPUT_VARIABLE listed
  COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL "\n  [^\n]+" tests "\n${listed}")
if(tests)
  message(FATAL_ERROR "no entry of ctest runs these: ${listed}")
endif()
