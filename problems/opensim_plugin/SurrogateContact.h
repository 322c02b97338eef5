/* An exported contact kernel as a force of OpenSim 4. Not built by this project: OpenSim's headers come with no
 * Python wheel. */
#ifndef SURROGATE_CONTACT_H
#define SURROGATE_CONTACT_H

#include <OpenSim/Simulation/Model/Force.h>
#include <OpenSim/Simulation/Model/PhysicalFrame.h>

/* Contact of two frames, each fixed to a body, by contact_loads of contact.h. */
class SurrogateContact : public OpenSim::Force {
  OpenSim_DECLARE_CONCRETE_OBJECT(SurrogateContact, OpenSim::Force);

 public:
  OpenSim_DECLARE_SOCKET(fixed, OpenSim::PhysicalFrame, "Frame of the fixed body's contact surface.");
  OpenSim_DECLARE_SOCKET(moving, OpenSim::PhysicalFrame, "Frame of the moving body's contact surface.");

  OpenSim::Array<std::string> getRecordLabels() const override;
  OpenSim::Array<double> getRecordValues(const SimTK::State& state) const override;

 protected:
  void computeForce(const SimTK::State& state, SimTK::Vector_<SimTK::SpatialVec>& bodyForces,
                    SimTK::Vector& generalizedForces) const override;

 private:
  /* Torque [N·m] and force [N] on the fixed body about the fixed frame's origin, in that frame. */
  SimTK::SpatialVec wrench(const SimTK::State& state) const;
};

#endif
