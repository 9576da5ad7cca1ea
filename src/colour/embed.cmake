# Makes the config a C string, so that the binary needs no file: cmake -DIN=config.ocio -DOUT=config.c -P embed.cmake
file(READ ${IN} text)
string(REPLACE "\\" "\\\\" text "${text}")
string(REPLACE "\"" "\\\"" text "${text}")
string(REPLACE "\n" "\\n\"\n    \"" text "${text}")
file(WRITE ${OUT}
    "/* Made from config.ocio. */\nextern const char cn_colour_config_text[];\n"
    "const char cn_colour_config_text[] =\n    \"${text}\";\n")
