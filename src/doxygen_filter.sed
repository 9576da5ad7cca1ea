# The comments of include/conurb as Doxygen wants them: what stands before a thing, what stands behind it, and the file's own.
1s#^/\* (conurb/[a-z]+\.h): #/** @file \1\n * #
/^ *\/\* ----/b
s#^( *)/\* #\1/** #
s#([^ ] +)/\* #\1/**< #
