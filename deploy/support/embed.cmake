# Writes a C++ source that holds files as character arrays, NAME() of HEADER and NAMESPACE:
# cmake -DOUT=FILE -DHEADER=HEADER -DNAMESPACE=NAMESPACE "-DFILES=NAME=PATH;..." -P embed.cmake
file(WRITE ${OUT}.new "#include \"${HEADER}\"\n\nnamespace ${NAMESPACE} {\n")
foreach(entry ${FILES})
  string(REGEX REPLACE "=.*" "" name "${entry}")
  string(REGEX REPLACE "^[^=]*=" "" path "${entry}")
  file(READ "${path}" hex HEX)
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "'\\\\x\\1'," bytes "${hex}")
  file(APPEND ${OUT}.new "static const char k_${name}[] = {${bytes}};\n"
    "std::string_view ${name}() { return {k_${name}, sizeof k_${name}}; }\n")
endforeach()
file(APPEND ${OUT}.new "}  // namespace ${NAMESPACE}\n")
file(RENAME ${OUT}.new ${OUT})
