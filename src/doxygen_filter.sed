# Turns the comments of include/conurb into those that Doxygen reads: of the file, before a thing, and behind a thing.
1s#^/\* (conurb/[a-z]+\.h): #/** @file \1\n * #
/^ *\/\* ----/b
s#^( *)/\* #\1/** #
s#([^ ] +)/\* #\1/**< #
