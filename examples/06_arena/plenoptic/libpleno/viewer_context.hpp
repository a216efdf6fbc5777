// Windows that show nothing, for libpleno in the place of libv/graphic: no Qt, no display.
#pragma once
#include <fstream>
#include <libv/core/image/types.hpp>
namespace v
{
struct ViewerContext {
	template <class... A> ViewerContext& title(A&&...) { return *this; }
	template <class... A> ViewerContext& size(A&&...) { return *this; }
	template <class... A> ViewerContext& background(A&&...) { return *this; }
	template <class... A> ViewerContext& interaction_mode(A&&...) { return *this; }
	template <class... A> ViewerContext& layer(A&&...) { return *this; }
	template <class... A> ViewerContext& name(A&&...) { return *this; }
	template <class... A> ViewerContext& point_style(A&&...) { return *this; }
	template <class... A> ViewerContext& pen_style(A&&...) { return *this; }
	template <class... A> ViewerContext& pen_color(A&&...) { return *this; }
	template <class... A> ViewerContext& pen_width(A&&...) { return *this; }
	template <class... A> ViewerContext& on_click(A&&...) { return *this; }
	ViewerContext& update() { return *this; }
	ViewerContext& clear() { return *this; }
};
inline ViewerContext viewer(int) { return {}; }
inline void wait_viewers() {}
inline void stop_viewers() {}
enum Interaction { INTERACTION_CAD };
enum Colour { dark_gray, white, red, green, blue, purple, yellow, orange, cyan, pink };
enum Style { Pixel, Cross, Round, SolidLine, DashLine };
template <class T> struct Palette {
	template <class... A> Colour operator[](A&&...) const { return white; }
	template <class... A> Colour get_color(A&&...) const { return white; }
};
}
