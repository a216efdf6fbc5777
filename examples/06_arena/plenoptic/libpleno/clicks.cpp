// The four clicks around the board that libpleno waits for, from a file: column and row of micro-images, frame by frame.
#include <cstdlib>
#include <fstream>
std::array<P2D, 4> extract_checkerboard_view(const Image&, const MIA&, double)
{
	static std::ifstream clicks(std::getenv("ARENA_CLICKS"));
	std::array<P2D, 4> view;
	for (auto& corner : view) clicks >> corner[0] >> corner[1];
	return view;
}
