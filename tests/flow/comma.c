/* The conurb program as one that sets its locale from the environment, as programs that embed the library do. */
#include <locale.h>

__attribute__((constructor)) static void set_locale(void)
{
    setlocale(LC_ALL, "");
}
