# Writes the sample terrain of SampleScenery to FOLDER/dem and its pyramid to FOLDER/cache, by BINARY.
file(REMOVE_RECURSE ${FOLDER})
file(MAKE_DIRECTORY ${FOLDER})
foreach(command "sample;${FOLDER}/dem;--south-deg;-11;--west-deg;43;--rows;2;--columns;2;--ppd;1024"
                "ingest;--dem;${FOLDER}/dem;--cache-dir;${FOLDER}/cache")
  execute_process(COMMAND ${BINARY} ${command} OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
endforeach()
