/* What OpenSim calls when it loads the plugin (opensim-cmd --library, opensim.LoadOpenSimLibrary). */
#include <OpenSim/Common/Object.h>

#include "SurrogateContact.h"

namespace {
struct Registered {
  Registered() { OpenSim::Object::registerType(SurrogateContact()); }
} registered;
}  // namespace
