#include "SurrogateContact.h"

#include <string>

extern "C" {
#include "contact.h"
}

namespace {

const std::string kComponents[6] = {"Fx", "Fy", "Fz", "Tx", "Ty", "Tz"};

/* Where a load such as "Fy_med" adds to a wrench: 0 to 5. */
int component(const std::string& load) {
  int place = 0;
  while (place < 5 && load.compare(0, 2, kComponents[place]) != 0) place++;
  return place;
}

/* Loads of patches are not added to a total that has a name itself. */
bool isNamedInTotal(int place) {
  for (int i = 0; i < CONTACT_LOADS; i++) {
    if (contact_load_names[i] == kComponents[place]) return true;
  }
  return false;
}

void push(const OpenSim::PhysicalFrame& frame, const SimTK::State& state, const SimTK::Vec3& at,
          const SimTK::SpatialVec& wrench, SimTK::Vector_<SimTK::SpatialVec>& bodyForces) {
  const SimTK::MobilizedBody& body = frame.getMobilizedBody();
  const SimTK::Vec3 arm = at - body.getBodyTransform(state).p();
  bodyForces[body.getMobilizedBodyIndex()] += SimTK::SpatialVec(wrench[0] + arm % wrench[1], wrench[1]);
}

}  // namespace

SimTK::SpatialVec SurrogateContact::wrench(const SimTK::State& state) const {
  const SimTK::Transform fixed = getConnectee<OpenSim::PhysicalFrame>("fixed").getTransformInGround(state);
  const SimTK::Transform moving = getConnectee<OpenSim::PhysicalFrame>("moving").getTransformInGround(state);
  const SimTK::Transform between = fixed.invert() * moving;
  const SimTK::Vec3 angles = between.R().convertRotationToBodyFixedXYZ();
  double pose[6], loads[CONTACT_LOADS];
  for (int i = 0; i < 3; i++) {
    pose[i] = 1e3 * between.p()[i];
    pose[3 + i] = angles[i];
  }
  contact_loads(pose, loads);
  SimTK::SpatialVec total(SimTK::Vec3(0), SimTK::Vec3(0));
  for (int i = 0; i < CONTACT_LOADS; i++) {
    const int place = component(contact_load_names[i]);
    if (isNamedInTotal(place) && contact_load_names[i] != kComponents[place]) continue;
    if (place < 3) total[1][place] += loads[i];
    else total[0][place - 3] += 1e-3 * loads[i];
  }
  return total;
}

void SurrogateContact::computeForce(const SimTK::State& state, SimTK::Vector_<SimTK::SpatialVec>& bodyForces,
                                    SimTK::Vector&) const {
  const auto& fixed = getConnectee<OpenSim::PhysicalFrame>("fixed");
  const SimTK::Transform frame = fixed.getTransformInGround(state);
  const SimTK::SpatialVec inFrame = wrench(state);
  const SimTK::SpatialVec inGround(frame.R() * inFrame[0], frame.R() * inFrame[1]);
  push(fixed, state, frame.p(), inGround, bodyForces);
  push(getConnectee<OpenSim::PhysicalFrame>("moving"), state, frame.p(), -inGround, bodyForces);
}

OpenSim::Array<std::string> SurrogateContact::getRecordLabels() const {
  OpenSim::Array<std::string> labels;
  for (const std::string& name : kComponents) labels.append(getName() + "." + name);
  return labels;
}

OpenSim::Array<double> SurrogateContact::getRecordValues(const SimTK::State& state) const {
  const SimTK::SpatialVec total = wrench(state);
  OpenSim::Array<double> values;
  for (int i = 0; i < 6; i++) values.append(i < 3 ? total[1][i] : total[0][i - 3]);
  return values;
}
